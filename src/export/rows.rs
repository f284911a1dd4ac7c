//! Where the rows of tables are read.

use super::{Export, ExportError};
use crate::store::{self, Moment};

/// What a table's rows are of.
pub(super) enum Rows {
    /// Each page as it is when it is read, so that no reading of the database lasts as long as its reader.
    ByPage,
    /// One moment, for tables that stand side by side.
    Of(Box<Moment>),
}

impl Rows {
    /// One moment for several tables.
    pub(super) fn of_one_moment(export: &Export) -> Result<Self, ExportError> {
        let moment = export.runtime.block_on(export.store.long_moment())?;
        Ok(Self::Of(Box::new(moment)))
    }

    /// Reads a page; all of it is of one moment.
    pub(super) fn page<T>(
        &mut self,
        export: &Export,
        read: impl AsyncFnOnce(&mut Moment) -> Result<T, store::Error>,
    ) -> Result<T, ExportError> {
        let page = export.runtime.block_on(async {
            match self {
                Self::ByPage => read(&mut export.store.moment().await?).await,
                Self::Of(moment) => read(moment).await,
            }
        })?;
        Ok(page)
    }
}

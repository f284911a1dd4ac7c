//! What each participant is paid beside the fee, in the columns that platforms take.

use std::io;

use super::cell::text;
use super::rows::Rows;
use super::wide::each_page;
use super::{Export, ExportError, Ids};
use crate::store::ParticipantRow;

/// The header: who, and how much in the study's currency.
pub(super) const HEADER: [&str; 2] = ["participant", "amount"];

/// One row per participant with a bonus. With ids of the platform, whoever came without one is left out, because the
/// platform cannot pay them.
pub(super) fn csv(export: &Export, out: &mut dyn io::Write) -> Result<u64, ExportError> {
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(HEADER)?;
    let mut count = 0;
    each_page(
        export,
        &mut Rows::ByPage,
        async |_, _| Ok(()),
        |participants, ()| {
            for participant in participants {
                let Some(amount) = amount(export, participant) else {
                    continue;
                };
                let id = match export.ids {
                    Ids::LeftOut => Some(participant.run.to_string()),
                    Ids::Hashed => participant.platform_key.as_deref().map(text),
                    Ids::Plain => export
                        .store
                        .plain_platform_id(export.study.id(), participant)
                        .map(text),
                };
                let Some(id) = id else { continue };
                writer.write_record([id, amount])?;
                count += 1;
            }
            Ok(())
        },
    )?;
    writer.flush()?;
    Ok(count)
}

/// A participant's bonus with the digits of its currency, which is that of the participant's version.
pub(super) fn amount(export: &Export, participant: &ParticipantRow) -> Option<String> {
    let terms = export.versions.of(participant.version).bonus();
    participant
        .bonus
        .map(|amount| terms.map_or_else(|| amount.to_string(), |terms| terms.digits(amount)))
}

//! Days and moments, as a language writes them.

use std::fmt::Display;

use super::{super::Timestamp, Words, fill};

impl Words {
    /// The day of a moment, in UTC.
    pub(crate) fn day_of(&self, at: Timestamp) -> String {
        let Ok(at) = jiff::Timestamp::from_millisecond(at.0) else {
            return format!("{} ms after 1970", at.0);
        };
        let date = at.to_zoned(jiff::tz::TimeZone::UTC).date();
        let number = date.month().to_string();
        let month = usize::try_from(date.month() - 1)
            .ok()
            .and_then(|index| self.months.split_whitespace().nth(index));
        let month = month.unwrap_or(&number);
        let parts: [(&str, &dyn Display); 3] = [
            ("day", &date.day()),
            ("month", &month),
            ("year", &date.year()),
        ];
        fill(&self.day, &parts)
    }

    pub(super) fn moment_of(&self, at: Timestamp) -> String {
        let time = jiff::Timestamp::from_millisecond(at.0)
            .map(|at| at.strftime("%H:%M").to_string())
            .unwrap_or_default();
        let parts: [(&str, &dyn Display); 2] = [("day", &self.day_of(at)), ("time", &time)];
        fill(&self.moment, &parts)
    }
}

//! Who is taken in, when, and for how long. Nothing here reads a clock: the time is an argument.

mod link;
pub(super) mod mturk;
pub(super) mod redirect;

use std::fmt;

use serde::{Deserialize, Serialize};

pub use self::{
    link::LinkParameter,
    mturk::{Mturk, NotMturk},
    redirect::RedirectTarget,
};
use super::Timestamp;

/// A kind of device, as far as a study can ask for one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Device {
    /// A screen for one hand.
    Phone,
    /// A larger screen without a keyboard.
    Tablet,
    /// A laptop or a desktop computer.
    Desktop,
}

impl Device {
    /// The name in study files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Phone => "phone",
            Self::Tablet => "tablet",
            Self::Desktop => "desktop",
        }
    }

    fn with_article(self) -> &'static str {
        match self {
            Self::Phone => "a phone",
            Self::Tablet => "a tablet",
            Self::Desktop => "a computer with a keyboard",
        }
    }
}

/// How the ids that recruiting platforms send are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecruitingIds {
    /// Under a keyed hash, except what [`LinkParameter::is_plain`] names.
    Hashed,
    /// As they are.
    Plain,
}

/// What a study file says under `[recruiting]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recruiting {
    /// How ids of recruiting platforms are stored.
    pub ids: RecruitingIds,
    /// How many people may be under way or have completed, over all versions of the study.
    pub quota: Option<u32>,
    /// The first moment at which somebody may start.
    pub opens: Option<Timestamp>,
    /// The first moment at which nobody may start any more.
    pub closes: Option<Timestamp>,
    /// The devices that are let in; empty for all.
    pub devices: Vec<Device>,
    /// After so many milliseconds an unfinished run gives its place back.
    pub time_limit_ms: Option<i64>,
    /// From this moment on ids and links are erased, and nobody can withdraw any more.
    pub retention: Option<Timestamp>,
    /// What the recruiting platform was told to require, for reports.
    pub filters: Vec<String>,
    /// Whether whoever starts may ask for more time at questions with a limit.
    pub more_time: bool,
    /// What is said of MTurk.
    pub mturk: Mturk,
}

/// Why somebody cannot start, though the study takes people in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NotAdmitted {
    /// The study has not begun.
    NotYet(Timestamp),
    /// The study is over.
    Over(Timestamp),
    /// The study needs one of these devices.
    Device(Vec<Device>),
    /// As many people as the study needs are under way or have completed.
    Full,
    /// They took part to an end and withdrew then.
    Withdrawn,
}

impl Recruiting {
    /// Whether somebody may start at `now` on a device; an unknown device is let in.
    ///
    /// # Errors
    /// Why not. Whether there is a place left is not known here.
    pub fn admit(&self, now: Timestamp, device: Option<Device>) -> Result<(), NotAdmitted> {
        if let Some(opens) = self.opens.filter(|opens| now < *opens) {
            return Err(NotAdmitted::NotYet(opens));
        }
        // Whoever started after the retention date could not withdraw any more.
        let ends = [self.closes, self.retention].into_iter().flatten().min();
        if let Some(end) = ends.filter(|end| now >= *end) {
            return Err(NotAdmitted::Over(end));
        }
        let is_other = |device: &Device| !self.devices.is_empty() && !self.devices.contains(device);
        if device.as_ref().is_some_and(is_other) {
            return Err(NotAdmitted::Device(self.devices.clone()));
        }
        Ok(())
    }
}

impl fmt::Display for NotAdmitted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotYet(opens) => write!(f, "the study begins on {}", moment(*opens)),
            Self::Over(closes) => write!(f, "the study ended on {}", moment(*closes)),
            Self::Device(devices) => {
                let names: Vec<&str> = devices.iter().map(|device| device.with_article()).collect();
                write!(
                    f,
                    "this study can only be taken on {}; open its link there",
                    names.join(" or ")
                )
            }
            Self::Full => f.write_str(
                "all places of this study are taken; one may become free, so you can try again later",
            ),
            Self::Withdrawn => f.write_str(
                "you took part in this study and withdrew afterwards; nobody can take part a second time",
            ),
        }
    }
}

fn moment(at: Timestamp) -> String {
    jiff::Timestamp::from_millisecond(at.0).map_or_else(
        |_| format!("{} ms after 1970", at.0),
        |at| at.strftime("%-d %B %Y, %H:%M UTC").to_string(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from_ten_to_twenty() -> Recruiting {
        Recruiting {
            ids: RecruitingIds::Hashed,
            quota: None,
            opens: Some(Timestamp(10)),
            closes: Some(Timestamp(20)),
            devices: vec![Device::Tablet, Device::Desktop],
            time_limit_ms: None,
            retention: None,
            filters: Vec::new(),
            more_time: false,
            mturk: Mturk::default(),
        }
    }

    #[test]
    fn a_study_takes_people_in_from_its_opening_until_before_its_closing() {
        let recruiting = from_ten_to_twenty();
        let at = |now| recruiting.admit(Timestamp(now), None);
        assert_eq!(at(9), Err(NotAdmitted::NotYet(Timestamp(10))));
        assert_eq!(at(10), Ok(()));
        assert_eq!(at(19), Ok(()));
        assert_eq!(at(20), Err(NotAdmitted::Over(Timestamp(20))));
    }

    #[test]
    fn nobody_is_taken_in_from_the_retention_date_on() {
        let open_end = Recruiting {
            closes: None,
            retention: Some(Timestamp(30)),
            ..from_ten_to_twenty()
        };
        assert_eq!(open_end.admit(Timestamp(29), None), Ok(()));
        assert_eq!(
            open_end.admit(Timestamp(30), None),
            Err(NotAdmitted::Over(Timestamp(30)))
        );
    }

    #[test]
    fn only_known_devices_are_turned_away() {
        let recruiting = from_ten_to_twenty();
        let on = |device| recruiting.admit(Timestamp(15), device);
        assert_eq!(
            on(Some(Device::Phone)),
            Err(NotAdmitted::Device(vec![Device::Tablet, Device::Desktop]))
        );
        assert_eq!(on(Some(Device::Tablet)), Ok(()));
        assert_eq!(on(None), Ok(()));
        let anywhere = Recruiting {
            devices: Vec::new(),
            ..recruiting
        };
        assert_eq!(anywhere.admit(Timestamp(15), Some(Device::Phone)), Ok(()));
    }

    #[test]
    fn reasons_are_told_with_dates_and_devices() {
        let opens = NotAdmitted::NotYet(Timestamp(1_796_115_600_000));
        assert_eq!(
            opens.to_string(),
            "the study begins on 1 December 2026, 09:00 UTC"
        );
        let device = NotAdmitted::Device(vec![Device::Tablet, Device::Desktop]);
        assert_eq!(
            device.to_string(),
            "this study can only be taken on a tablet or a computer with a keyboard; open its link there"
        );
    }
}

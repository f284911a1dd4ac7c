//! Who is taken in: dates, quota, devices, the time for a run.

use jiff::civil::{Date, DateTime};
use jiff::tz::TimeZone;

use super::rules;
use crate::study::document::{Fault, KeyPath};
use crate::study::file::{RawIds, RawMturk, RawRecruiting};
use crate::study::recruiting::mturk;
use crate::study::{Mturk, Recruiting, RecruitingIds, Timestamp};

const MOST_PEOPLE: u32 = 1_000_000;
/// A week.
const LONGEST_TIME_MIN: u32 = 10_080;
const LEAST_USUAL_TIME_MIN: u32 = 30;
/// Where a place is worth something, a run may take so many times what is announced.
const USUAL_TIMES: u32 = 6;

/// Which moment of a day a date without a time stands for.
#[derive(Debug, Clone, Copy)]
enum Day {
    Begin,
    End,
}

/// Reads `[recruiting]`. Where places are counted, an unfinished run has to give its own back some time.
pub(super) fn read(
    raw: &RawRecruiting,
    minutes: u32,
    has_conditions: bool,
) -> Result<Recruiting, Fault> {
    let path = KeyPath::root().key("recruiting");
    if let Some(quota) = raw.quota.filter(|quota| !(1..=MOST_PEOPLE).contains(quota)) {
        return Err(path
            .key("quota")
            .fault(quota, format!("a whole number from 1 to {MOST_PEOPLE}")));
    }
    let opens = date(raw.opens, Day::Begin, &path.key("opens"))?;
    let closes = date(raw.closes, Day::End, &path.key("closes"))?;
    let retention = date(raw.retention, Day::End, &path.key("retention"))?;
    if let (Some(opens), Some(closes), Some(found)) = (opens, closes, raw.closes)
        && closes <= opens
    {
        return Err(path.key("closes").fault(found, "a moment after `opens`"));
    }
    if let (Some(closes), Some(retention), Some(found)) = (closes, retention, raw.retention)
        && retention < closes
    {
        return Err(path
            .key("retention")
            .fault(found, "a date that is not before `closes`"));
    }
    if let (Some(opens), Some(retention), Some(found)) = (opens, retention, raw.retention)
        && retention <= opens
    {
        return Err(path.key("retention").fault(found, "a date after `opens`"));
    }
    let devices = raw.devices.clone().unwrap_or_default();
    if raw.devices.as_ref().is_some_and(Vec::is_empty) {
        let allowed = "`phone`, `tablet`, `desktop`, one or more; leave the key out for all";
        return Err(path.key("devices").fault("an empty list", allowed));
    }
    for (index, device) in devices.iter().enumerate() {
        if devices[..index].contains(device) {
            let found = format!("`{}` for the second time", device.as_str());
            return Err(path
                .key("devices")
                .index(index)
                .fault(found, "each device once"));
        }
    }
    for (index, filter) in raw.filters.iter().enumerate() {
        rules::line(filter, &path.key("filters").index(index))?;
    }
    Ok(Recruiting {
        ids: ids(raw),
        quota: raw.quota,
        opens,
        closes,
        devices,
        time_limit_ms: time_limit_min(raw, minutes, has_conditions, &path)?
            .map(|minutes| i64::from(minutes) * 60_000),
        retention,
        filters: raw.filters.clone(),
        mturk: read_mturk(&raw.mturk, &path.key("mturk"))?,
    })
}

/// How ids of recruiting platforms are stored.
pub(super) fn ids(raw: &RawRecruiting) -> RecruitingIds {
    match raw.ids {
        RawIds::Hashed => RecruitingIds::Hashed,
        RawIds::Plain => RecruitingIds::Plain,
    }
}

fn read_mturk(raw: &RawMturk, path: &KeyPath) -> Result<Mturk, Fault> {
    for (index, site) in raw.sites.iter().enumerate() {
        if !mturk::is_site(site) {
            let allowed = "https:// with a host in small letters, or http:// with localhost or 127.0.0.1, a port if needed, and nothing behind it";
            return Err(path
                .key("sites")
                .index(index)
                .fault(rules::shown(site), allowed));
        }
    }
    Ok(Mturk {
        frame: raw.frame,
        sites: raw.sites.clone(),
    })
}

fn time_limit_min(
    raw: &RawRecruiting,
    minutes: u32,
    has_conditions: bool,
    path: &KeyPath,
) -> Result<Option<u32>, Fault> {
    match raw.time_limit_min {
        Some(limit) if !(minutes..=LONGEST_TIME_MIN).contains(&limit) => {
            let allowed =
                format!("a whole number from {minutes}, which is `minutes`, to {LONGEST_TIME_MIN}");
            Err(path.key("time_limit_min").fault(limit, allowed))
        }
        Some(limit) => Ok(Some(limit)),
        None if raw.quota.is_some() || has_conditions => {
            Ok(Some(LEAST_USUAL_TIME_MIN.max(USUAL_TIMES * minutes)))
        }
        None => Ok(None),
    }
}

fn date(
    found: Option<toml::value::Datetime>,
    day: Day,
    at: &KeyPath,
) -> Result<Option<Timestamp>, Fault> {
    let Some(found) = found else {
        return Ok(None);
    };
    let moment = match (found.date, found.time, found.offset) {
        (Some(_), Some(_), Some(_)) => found.to_string().parse::<jiff::Timestamp>().ok(),
        (Some(_), None, None) => found.to_string().parse::<Date>().ok().and_then(|date| {
            let date = match day {
                Day::Begin => date,
                Day::End => date.tomorrow().ok()?,
            };
            let begin: DateTime = date.into();
            Some(TimeZone::UTC.to_zoned(begin).ok()?.timestamp())
        }),
        _ => None,
    };
    let moment = moment.ok_or_else(|| {
        let allowed = "a date such as 2026-12-01, or a date and time with its offset such as 2026-12-01T09:00:00Z";
        at.fault(found, allowed)
    })?;
    Ok(Some(Timestamp(moment.as_millisecond())))
}

//! Which device somebody uses, as far as their browser tells.

use crate::study::Device;

/// A best guess from the headers `Sec-CH-UA-Mobile` and `User-Agent`; nothing for a browser that tells neither.
///
/// A browser can say what it likes, and tablets like to pass for computers: Safari on an iPad does unless it is told
/// otherwise.
pub(super) fn guess(mobile: Option<&str>, agent: Option<&str>) -> Option<Device> {
    let says =
        |words: &[&str]| agent.is_some_and(|agent| words.iter().any(|word| agent.contains(word)));
    let is_mobile = mobile == Some("?1") || says(&["Mobile", "iPhone", "iPod"]);
    if says(&["iPad", "Tablet", "PlayBook", "Silk/"]) || (says(&["Android"]) && !is_mobile) {
        Some(Device::Tablet)
    } else if is_mobile {
        Some(Device::Phone)
    } else if mobile == Some("?0") || says(&["Windows NT", "Macintosh", "X11", "CrOS"]) {
        Some(Device::Desktop)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(mobile: Option<&str>, agent: &str, device: Option<Device>) {
        assert_eq!(guess(mobile, Some(agent)), device, "{agent}");
    }

    #[test]
    fn usual_browsers_are_told_apart() {
        let phone = Some(Device::Phone);
        check(
            None,
            "Mozilla/5.0 (iPhone; CPU iPhone OS 18_5 like Mac OS X) AppleWebKit/605.1.15 Version/18.5 Mobile/15E148 Safari/604.1",
            phone,
        );
        check(
            Some("?1"),
            "Mozilla/5.0 (Linux; Android 10; K) AppleWebKit/537.36 Chrome/137.0.0.0 Mobile Safari/537.36",
            phone,
        );
        check(
            None,
            "Mozilla/5.0 (Android 15; Mobile; rv:139.0) Gecko/139.0 Firefox/139.0",
            phone,
        );
        let tablet = Some(Device::Tablet);
        check(
            Some("?0"),
            "Mozilla/5.0 (Linux; Android 10; K) AppleWebKit/537.36 Chrome/137.0.0.0 Safari/537.36",
            tablet,
        );
        check(
            None,
            "Mozilla/5.0 (Android 15; Tablet; rv:139.0) Gecko/139.0 Firefox/139.0",
            tablet,
        );
        check(
            None,
            "Mozilla/5.0 (iPad; CPU OS 17_7 like Mac OS X) AppleWebKit/605.1.15 Version/17.7 Mobile/15E148 Safari/604.1",
            tablet,
        );
        let desktop = Some(Device::Desktop);
        check(
            Some("?0"),
            "Mozilla/5.0 (Windows NT 10.0; Win64; x64) AppleWebKit/537.36 Chrome/137.0.0.0 Safari/537.36",
            desktop,
        );
        check(
            None,
            "Mozilla/5.0 (X11; Linux x86_64; rv:139.0) Gecko/20100101 Firefox/139.0",
            desktop,
        );
        check(
            None,
            "Mozilla/5.0 (Macintosh; Intel Mac OS X 10_15_7) AppleWebKit/605.1.15 Version/18.5 Safari/605.1.15",
            desktop,
        );
    }

    #[test]
    fn a_browser_that_tells_nothing_stays_unknown() {
        assert_eq!(guess(None, None), None);
        check(None, "curl/8.14.1", None);
        check(None, "", None);
    }
}

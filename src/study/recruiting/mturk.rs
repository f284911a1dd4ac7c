//! Studies inside MTurk's frame.

/// What a study file says under `[recruiting.mturk]`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Mturk {
    /// Whether MTurk may show the study in its frame.
    pub frame: bool,
    /// Further origins that are treated like MTurk's own, such as `http://localhost:4000`: for trying a study out without
    /// MTurk.
    pub sites: Vec<String>,
}

/// A site that finished assignments are not sent to.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the link's parameter turkSubmitTo names `{found}`, which is not MTurk; allowed: {allowed}"
)]
pub struct NotMturk {
    /// What the link names.
    pub found: String,
    /// The origins that may stand there.
    pub allowed: String,
}

impl Mturk {
    /// MTurk's sites: where workers work and its pages hold the frame, where it began, and its sandbox.
    const OWN: [&'static str; 3] = [
        "https://worker.mturk.com",
        "https://www.mturk.com",
        "https://workersandbox.mturk.com",
    ];
    /// The sites that take finished assignments.
    const TAKING: [&'static str; 2] = ["https://www.mturk.com", "https://workersandbox.mturk.com"];

    /// The origins that may show the study's pages in a frame: none where the study does not say so.
    pub fn framing_sites(&self) -> Vec<&str> {
        if !self.frame {
            return Vec::new();
        }
        self.with_own(&Self::OWN)
    }

    /// The origins to which the form with a finished assignment may lead. It is sent to one of them, but that one may send
    /// the browser on to another of MTurk's hosts, and browsers such as Chromium hold redirects of a form against the
    /// page's policy too.
    pub fn submitting_sites(&self) -> Vec<&str> {
        self.with_own(&Self::OWN)
    }

    /// The origin that a link's `turkSubmitTo` names.
    ///
    /// # Errors
    /// When it is neither MTurk's nor one that the study file names: a made-up link must not send workers elsewhere.
    pub fn taking_site(&self, submit_to: &str) -> Result<&str, NotMturk> {
        let sites = self.with_own(&Self::TAKING);
        let asked = submit_to.strip_suffix('/').unwrap_or(submit_to);
        let found = sites.iter().find(|site| asked.eq_ignore_ascii_case(site));
        found.copied().ok_or_else(|| NotMturk {
            found: submit_to.to_owned(),
            allowed: sites.join(", "),
        })
    }

    fn with_own<'a>(&'a self, known: &[&'a str]) -> Vec<&'a str> {
        let own = self.sites.iter().map(String::as_str);
        known.iter().copied().chain(own).collect()
    }
}

/// Whether a text is an origin that can stand for MTurk: `https` with a host, or `http` on this machine, with a port if
/// needed and nothing behind it.
pub(in crate::study) fn is_site(text: &str) -> bool {
    let Some((scheme, rest)) = text.split_once("://") else {
        return false;
    };
    let (host, port) = match rest.split_once(':') {
        Some((host, port)) => (host, Some(port)),
        None => (rest, None),
    };
    let is_host = !host.is_empty()
        && host.bytes().all(|byte| {
            byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'.' || byte == b'-'
        });
    let is_port = port.is_none_or(|port| port.parse::<u16>().is_ok_and(|port| port > 0));
    let is_here = host == "localhost" || host.ends_with(".localhost") || host == "127.0.0.1";
    is_host && is_port && (scheme == "https" || (scheme == "http" && is_here))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finished_assignments_go_to_mturk_and_to_sites_that_the_file_names() {
        let mut mturk = Mturk::default();
        assert_eq!(
            mturk.taking_site("https://www.mturk.com/"),
            Ok("https://www.mturk.com")
        );
        assert_eq!(
            mturk.taking_site("https://WorkerSandbox.mturk.com"),
            Ok("https://workersandbox.mturk.com")
        );
        for other in [
            "https://www.mturk.com.evil.example",
            "https://evil.example/https://www.mturk.com",
            "http://www.mturk.com",
            "https://www.mturk.com/else",
            "javascript:alert(1)",
            "http://localhost:4000",
        ] {
            assert!(mturk.taking_site(other).is_err(), "{other}");
        }
        mturk.sites.push("http://localhost:4000".to_owned());
        assert_eq!(
            mturk.taking_site("http://localhost:4000/"),
            Ok("http://localhost:4000")
        );
    }

    #[test]
    fn a_finished_assignment_may_be_led_on_to_each_of_mturks_hosts() {
        let mturk = Mturk::default();
        let sites = mturk.submitting_sites();
        assert!(Mturk::TAKING.iter().all(|site| sites.contains(site)));
        assert!(sites.contains(&"https://worker.mturk.com"));
        assert!(sites.iter().all(|site| is_site(site)));
    }

    #[test]
    fn nobody_frames_a_study_that_does_not_say_so() {
        let closed = Mturk {
            frame: false,
            sites: vec!["http://localhost:4000".to_owned()],
        };
        assert_eq!(closed.framing_sites(), Vec::<&str>::new());
        let open = Mturk {
            frame: true,
            ..closed
        };
        assert!(open.framing_sites().contains(&"https://worker.mturk.com"));
        assert!(open.framing_sites().contains(&"http://localhost:4000"));
    }

    #[test]
    fn sites_are_origins_over_https_or_on_this_machine() {
        for site in [
            "https://example.org",
            "https://a-b.example:8443",
            "http://localhost:4000",
            "http://127.0.0.1:1",
        ] {
            assert!(is_site(site), "{site}");
        }
        for other in [
            "http://example.org",
            "https://",
            "https://a b",
            "https://example.org/",
            "https://example.org:0",
            "https://example.org;",
            "https://*.example.org",
            "https://A.example",
            "example.org",
            "ftp://localhost",
            "https://a:b:1",
        ] {
            assert!(!is_site(other), "{other}");
        }
    }
}

//! What recruiting platforms put into the links that they show.

use super::RecruitingIds;

/// A parameter of a recruiting link that is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LinkParameter {
    /// Prolific's id of the person.
    ProlificPid,
    /// Prolific's id of the study.
    ProlificStudy,
    /// Prolific's id of this person's place in it.
    ProlificSession,
    /// MTurk's id of the person.
    MturkWorker,
    /// MTurk's id of the piece of work that a worker accepted.
    MturkAssignment,
    /// MTurk's id of the task.
    MturkHit,
    /// The site that takes the finished assignment.
    MturkSubmitTo,
    /// SONA's number of the person in the study.
    SonaSurveyCode,
    /// The same, under the shorter name that SONA's own instructions use.
    SonaId,
    /// The person, as whoever gave the link out names them.
    Pid,
}

impl LinkParameter {
    /// What MTurk sends as the assignment while somebody only looks at the task.
    pub const MTURK_LOOK: &'static str = "ASSIGNMENT_ID_NOT_AVAILABLE";

    /// All of them, in the order in which they are read.
    pub const ALL: [Self; 10] = [
        Self::ProlificPid,
        Self::ProlificStudy,
        Self::ProlificSession,
        Self::MturkWorker,
        Self::MturkAssignment,
        Self::MturkHit,
        Self::MturkSubmitTo,
        Self::SonaSurveyCode,
        Self::SonaId,
        Self::Pid,
    ];

    /// Its name in links and in the placeholders of redirects.
    pub fn name(self) -> &'static str {
        match self {
            Self::ProlificPid => "PROLIFIC_PID",
            Self::ProlificStudy => "STUDY_ID",
            Self::ProlificSession => "SESSION_ID",
            Self::MturkWorker => "workerId",
            Self::MturkAssignment => "assignmentId",
            Self::MturkHit => "hitId",
            Self::MturkSubmitTo => "turkSubmitTo",
            Self::SonaSurveyCode => "survey_code",
            Self::SonaId => "id",
            Self::Pid => "pid",
        }
    }

    /// The platform whose person it names, if it names one.
    pub fn platform(self) -> Option<&'static str> {
        match self {
            Self::ProlificPid => Some("prolific"),
            Self::MturkWorker => Some("mturk"),
            Self::SonaSurveyCode | Self::SonaId => Some("sona"),
            Self::Pid => Some("pid"),
            Self::ProlificStudy
            | Self::ProlificSession
            | Self::MturkAssignment
            | Self::MturkHit
            | Self::MturkSubmitTo => None,
        }
    }

    /// Whether it is stored as it is. MTurk takes a finished assignment back only under the id that it gave out, which
    /// names a piece of work and no person, so that id and the site that takes it are never hashed.
    pub fn is_plain(self, ids: RecruitingIds) -> bool {
        match self {
            Self::MturkAssignment | Self::MturkSubmitTo => true,
            Self::ProlificPid
            | Self::ProlificStudy
            | Self::ProlificSession
            | Self::MturkWorker
            | Self::MturkHit
            | Self::SonaSurveyCode
            | Self::SonaId
            | Self::Pid => ids == RecruitingIds::Plain,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_names_no_person_stays_plain_where_ids_are_hashed() {
        for parameter in LinkParameter::ALL {
            assert!(parameter.is_plain(RecruitingIds::Plain));
            let stays = parameter.is_plain(RecruitingIds::Hashed);
            assert!(!(stays && parameter.platform().is_some()), "{parameter:?}");
        }
        assert!(LinkParameter::MturkAssignment.is_plain(RecruitingIds::Hashed));
    }
}

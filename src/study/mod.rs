//! Studies: the file that describes one, and the steps of a person's run through it.
//!
//! A study file (TOML) is parsed once, at the edge, into a [`Study`] that cannot be wrong. A run's steps are drawn
//! from it at the run's start ([`Study::draw_steps`]) and stored; each stored step is turned into what the page shows
//! with [`Study::step`], which also reads what the page posts. Nothing here reads files, clocks or global randomness.
//!
//! In reading order:
//! * `definition`: [`Study`] and what it tells about itself,
//! * `cell`: cells of the design and the baseline questions,
//! * `plan`: what is fitted, and how; `sequential`: when there is enough of it,
//! * `condition`: what differs between people; `recruiting`: who is taken in,
//! * `exclusion`: whom the analysis leaves out,
//! * `draw`: a run's list of steps; `bonus`: what is paid for them; `contents`: what each block shows and asks,
//! * [`step`]: what each kind of step shows and accepts,
//! * `timing`: the rules of time limits,
//! * `words`: what the program itself says on participants' pages, in each language,
//! * `parse`: from text to [`Study`], with `file` (the keys), `document` (where a key stands), `template` and `markup`
//!   (texts),
//! * `structure`: what translations leave as it is,
//! * `outline`: what a run consists of and how long it takes,
//! * `built_in`: the studies compiled into the program.

mod bonus;
mod built_in;
mod cell;
mod condition;
mod contents;
mod definition;
mod document;
mod draw;
mod error;
mod exclusion;
mod file;
mod id;
mod instructed;
mod markup;
mod outline;
mod parse;
mod participants_paragraph;
mod plan;
mod recruiting;
mod sequential;
pub mod step;
mod structure;
mod template;
mod timing;
mod words;

pub use bonus::{Bonus, BonusTerms, DrawnChoice, PayableChoice, draw as draw_bonus};
pub use built_in::{built_in, starter};
pub use cell::{ActionLabel, Baseline, Cell};
pub use condition::{Condition, ConditionId};
pub use contents::{AskedQuestion, Asks, BlockContents};
pub use definition::{
    Assign, CompletionCode, Ending, EndingPage, Factor, Include, Level, RewardUnit,
    StatedHypothesis, Study,
};
pub use draw::{StepData, StepKind, StepPlan};
pub use error::ParseError;
pub use exclusion::{ExclusionRule, Flag, exclusions_in_words};
pub use id::{
    ActionId, BlockId, CellId, FactorId, LevelId, PartId, PlanId, QuestionId, ReplayId, StudyId,
};
pub use instructed::InstructedItem;
pub use outline::{DURATION_RULE, OutlinedStep, WORDS_PER_MINUTE};
pub use participants_paragraph::ParticipantFacts;
pub use plan::{
    FitPlan, FitSettings, MeanSd, PaperFigure, PlanPart, PriorChange, Priors, Weighting,
};
pub use recruiting::{
    Device, LinkParameter, Mturk, NotAdmitted, NotMturk, Recruiting, RecruitingIds, RedirectTarget,
};
pub use sequential::{KeyInterval, Sequential, StoppingRule};
pub use step::{Reply, Step, StepError};
pub use timing::{Arrival, DEFAULT_GRACE_MS, Deadline, TimeFactor, TimeFactorError, Timestamp};
pub use words::Words;

//! A study, and what it tells about itself.

use std::ops::Range;

use super::document::{Document, KeyPath};
use super::step::{
    ChoiceQuestion, ConsentText, DeclinedPage, FormText, InfoText, NamedReplay, ReplaysText,
};
use super::{
    Baseline, BlockId, Bonus, Cell, Condition, FactorId, FitPlan, FitSettings, LevelId,
    PaperFigure, ParseError, Recruiting, RedirectTarget, Sequential, StudyId, Words, parse,
};
use crate::model::ChoiceModel;

/// A study as its file describes it, checked as a whole.
#[derive(Debug, Clone)]
pub struct Study {
    /// The first is that of the file's own texts; a translation has one alone.
    pub(super) languages: Vec<String>,
    /// The study in its other languages, in their order.
    pub(super) translations: Vec<Study>,
    pub(super) untranslated: Vec<String>,
    pub(super) words: Words,
    pub(super) text: String,
    pub(super) hash: String,
    pub(super) id: StudyId,
    pub(super) title: String,
    pub(super) summary: String,
    pub(super) minutes: u32,
    pub(super) contact: String,
    pub(super) reward_unit: RewardUnit,
    pub(super) reference_reward: f64,
    pub(super) factors: Vec<Factor>,
    pub(super) draws_action_order: bool,
    pub(super) blocks: Vec<Block>,
    pub(super) cells: Vec<Cell>,
    pub(super) baseline: Vec<Baseline>,
    pub(super) baseline_share: Option<f64>,
    pub(super) endings: Endings,
    pub(super) bonus: Option<Bonus>,
    pub(super) is_open_at_first: bool,
    pub(super) conditions: Vec<Condition>,
    pub(super) recruiting: Recruiting,
    pub(super) include: Include,
    pub(super) blind_until: Option<u64>,
    pub(super) hypothesis: Option<StatedHypothesis>,
    pub(super) sequential: Sequential,
    pub(super) fit: FitSettings,
    pub(super) plans: Vec<FitPlan>,
    pub(super) paper: Vec<PaperFigure>,
}

impl Study {
    /// Parses a study file. `file_name` only serves error messages.
    ///
    /// # Errors
    /// The first thing that is wrong with the file: where it is, what was found and what is allowed.
    pub fn parse(file_name: &str, text: &str) -> Result<Self, ParseError> {
        parse::study(file_name, text).map_err(|mut errors| errors.swap_remove(0))
    }

    /// Parses a study file like [`Study::parse`], naming more than the first error.
    ///
    /// # Errors
    /// What is wrong with the file, one error or more: the first of each part (the head, each block, and so on). What
    /// depends on a faulty part is looked at only when that is right.
    pub fn check(file_name: &str, text: &str) -> Result<Self, Vec<ParseError>> {
        parse::study(file_name, text)
    }

    /// The languages in which it can be taken, as tags such as `de`; that of the file's own texts first. A
    /// [translation](Study::in_language) tells its own language alone.
    pub fn languages(&self) -> &[String] {
        &self.languages
    }

    /// The language of its texts.
    pub fn language(&self) -> &str {
        &self.words.language
    }

    /// The study with the texts of another language: the same ids, steps and problems, and the file's own texts where
    /// one is not translated. Itself for a language that it does not have.
    pub fn in_language(&self, language: &str) -> &Self {
        let mut translations = self.translations.iter();
        let found = translations.find(|study| study.language() == language);
        found.unwrap_or(self)
    }

    /// The paths of the file's texts that this translation lacks; nothing in the file's own language.
    pub fn untranslated(&self) -> &[String] {
        &self.untranslated
    }

    /// Whether the program has words of its own for this language; where not, they are English unless the study file
    /// words them anew.
    pub fn has_page_words(&self) -> bool {
        Words::has_catalogue(self.language())
    }

    /// What the program itself says on the pages of this study.
    pub fn words(&self) -> &Words {
        &self.words
    }

    /// The line of a key of the study file, given as the tables that lead to it and its own name; none where it is missing.
    pub fn line_of(&self, keys: &[&str]) -> Option<usize> {
        let document = Document::parse("", &self.text).ok()?;
        let path = keys.iter().fold(KeyPath::root(), |path, key| path.key(key));
        if !document.has(&path) {
            return None;
        }
        document.refuse(&path.fault("", "")).line()
    }

    /// The study's id, which its links carry.
    pub fn id(&self) -> &StudyId {
        &self.id
    }

    /// The title that participants see.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// One line about the study, for lists.
    pub fn summary(&self) -> &str {
        &self.summary
    }

    /// How long a run takes, in minutes.
    pub fn minutes(&self) -> u32 {
        self.minutes
    }

    /// Whom participants can ask.
    pub fn contact(&self) -> &str {
        &self.contact
    }

    /// The unit of rewards.
    pub fn reward_unit(&self) -> &RewardUnit {
        &self.reward_unit
    }

    /// The reward that the unit-free sensitivity refers to (models.md, section 4): never zero.
    pub fn reference_reward(&self) -> f64 {
        self.reference_reward
    }

    /// The factors of the design, in file order.
    pub fn factors(&self) -> &[Factor] {
        &self.factors
    }

    /// The cells of the design, in file order.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The cell with this id.
    pub fn cell(&self, id: &str) -> Option<&Cell> {
        self.cells.iter().find(|cell| cell.id == *id)
    }

    /// The fit plans, in file order; at least one.
    pub fn plans(&self) -> &[FitPlan] {
        &self.plans
    }

    /// How the models are fitted.
    pub fn fit(&self) -> &FitSettings {
        &self.fit
    }

    /// The baseline questions, in file order.
    pub fn baseline(&self) -> &[Baseline] {
        &self.baseline
    }

    /// The share of optimal answers to baseline questions in the source paper.
    pub fn baseline_share(&self) -> Option<f64> {
        self.baseline_share
    }

    /// The source paper's figures, in file order.
    pub fn paper(&self) -> &[PaperFigure] {
        &self.paper
    }

    /// What a completed run shows and where it leads.
    pub fn completion(&self) -> &EndingPage {
        self.ending(Ending::Completed)
    }

    /// What a run that ended in this way shows and where it leads.
    pub fn ending(&self, ending: Ending) -> &EndingPage {
        match ending {
            Ending::Completed => &self.endings.completed,
            Ending::ScreenedOut => &self.endings.screened_out,
            Ending::FailedCheck => &self.endings.failed_check,
            Ending::TimedOut => &self.endings.timed_out,
        }
    }

    /// What is paid beside the fee, if anything is.
    pub fn bonus(&self) -> Option<&Bonus> {
        self.bonus.as_ref()
    }

    /// What somebody who does not consent is shown; `None` in a study that asks for no consent.
    pub fn declined_page(&self) -> Option<DeclinedPage<'_>> {
        self.blocks.iter().find_map(|block| match &block.body {
            BlockBody::Consent(text) => Some(text.step().declined),
            BlockBody::Info(_)
            | BlockBody::Replays(_)
            | BlockBody::Choice(_)
            | BlockBody::Form(_) => None,
        })
    }

    /// The replays that its blocks show, in file order.
    pub fn replays(&self) -> impl Iterator<Item = &NamedReplay> {
        self.blocks.iter().flat_map(|block| match &block.body {
            BlockBody::Replays(text) => text.replays.as_slice(),
            BlockBody::Consent(_)
            | BlockBody::Info(_)
            | BlockBody::Choice(_)
            | BlockBody::Form(_) => &[],
        })
    }

    /// Whether it takes people in as soon as it is first loaded; else it begins as a draft.
    pub fn is_open_at_first(&self) -> bool {
        self.is_open_at_first
    }

    /// The conditions between which people are divided, the first factor changing slowest; none in a study whose
    /// people all meet the same.
    pub fn conditions(&self) -> &[Condition] {
        &self.conditions
    }

    /// The condition whose people meet a cell; none in a study without conditions.
    pub fn condition_of(&self, cell: &Cell) -> Option<&Condition> {
        self.conditions
            .iter()
            .find(|condition| condition.takes(&cell.levels))
    }

    /// Who is taken in, when, and for how long.
    pub fn recruiting(&self) -> &Recruiting {
        &self.recruiting
    }

    /// Whose answers are analysed.
    pub fn include(&self) -> Include {
        self.include
    }

    /// How many people must have completed the study before anything is shown that tells how the models do.
    pub fn blind_until(&self) -> Option<u64> {
        self.blind_until
    }

    /// What the study wants to find out about two of its models.
    pub fn hypothesis(&self) -> Option<&StatedHypothesis> {
        self.hypothesis.as_ref()
    }

    /// How evidence is followed while people take part, and when it is enough.
    pub fn sequential(&self) -> &Sequential {
        &self.sequential
    }

    /// The models that are fitted, from the plainest to the richest.
    pub fn models(&self) -> &[&'static ChoiceModel] {
        &self.fit.models
    }

    /// The study file.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// SHA-256 of the study file, in lower-case hexadecimal digits.
    pub fn hash(&self) -> &str {
        &self.hash
    }
}

/// The claim that one model predicts people better than another.
#[derive(Debug, Clone, PartialEq)]
pub struct StatedHypothesis {
    /// Its name, such as `H1`.
    pub id: String,
    /// The claim in words, without a full stop.
    pub statement: String,
    /// The model that should be better.
    pub better: &'static ChoiceModel,
    /// The other one.
    pub than: &'static ChoiceModel,
}

/// The unit in which rewards are counted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RewardUnit {
    /// Its name in the plural, such as `US dollars`.
    pub name: String,
    /// What stands before a number, such as `$`.
    pub prefix: String,
    /// What stands after a number, such as ` points`.
    pub suffix: String,
}

impl RewardUnit {
    /// A reward with its unit, such as `−$500`.
    pub fn format(&self, reward: f64) -> String {
        let sign = if reward < 0.0 { "\u{2212}" } else { "" };
        format!("{sign}{}{}{}", self.prefix, reward.abs(), self.suffix)
    }
}

/// A factor of the design.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Factor {
    /// Its id.
    pub id: FactorId,
    /// Its text on pages.
    pub label: String,
    /// Whether each person meets all of its levels or one.
    pub assign: Assign,
    /// Its levels, in file order; at least one.
    pub levels: Vec<Level>,
}

/// How the levels of a factor meet people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Assign {
    /// Each person meets every level.
    #[default]
    Within,
    /// Each person meets one level, the same throughout.
    Between,
}

/// A level of a factor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Level {
    /// Its id.
    pub id: LevelId,
    /// Its text on pages.
    pub label: String,
}

/// How a run ends that somebody agreed to, and did not withdraw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// With its last step.
    Completed,
    /// With an answer of somebody whom the study does not look for.
    ScreenedOut,
    /// With the last wrong attempt at a comprehension check.
    FailedCheck,
    /// Unfinished, when its time was over.
    TimedOut,
}

impl Ending {
    /// The name in study files and in what a platform is told.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::ScreenedOut => "screened_out",
            Self::FailedCheck => "failed_check",
            Self::TimedOut => "timed_out",
        }
    }
}

/// The page of each ending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Endings {
    pub(super) completed: EndingPage,
    pub(super) screened_out: EndingPage,
    pub(super) failed_check: EndingPage,
    pub(super) timed_out: EndingPage,
}

/// What a run shows that has ended, and where it leads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EndingPage {
    /// The heading.
    pub title: String,
    /// The text as HTML.
    pub text_html: String,
    /// The code that tells a recruiting platform how the run ended.
    pub code: CompletionCode,
    /// Where people are sent from it, if the study sends them anywhere.
    pub redirect: Option<RedirectTarget>,
}

/// Where codes come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CompletionCode {
    /// The same for everybody, as Prolific wants it: letters, digits, `-` and `_`.
    Fixed(String),
    /// One per run.
    PerRun,
    /// There is none.
    Absent,
}

/// Whose answers are analysed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Include {
    /// Those of people who finished.
    Completed,
    /// Every valid answer as soon as it is given; withdrawn ones are erased.
    All,
}

/// A block of the study file.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub(super) id: BlockId,
    pub(super) body: BlockBody,
}

/// What a block consists of.
#[derive(Debug, Clone)]
pub(super) enum BlockBody {
    Consent(ConsentText),
    Info(InfoText),
    Replays(ReplaysText),
    Choice(Choices),
    Form(FormText),
}

/// The questions of a choice block.
#[derive(Debug, Clone)]
pub(super) struct Choices {
    pub(super) limit_ms: Option<u64>,
    pub(super) start: Option<InfoText>,
    pub(super) order: Order,
    pub(super) units: Vec<Unit>,
    pub(super) questions: Vec<ChoiceQuestion>,
}

/// Questions that stay together whatever the order of the block: a group, or a question of its own.
#[derive(Debug, Clone)]
pub(super) struct Unit {
    pub(super) order: Order,
    pub(super) questions: Range<usize>,
}

/// Whether an order is that of the file or drawn for each run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Order {
    #[default]
    Fixed,
    Random,
}

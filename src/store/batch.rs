//! A group of participants' jobs: loaded together, judged one after the other, written together.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use sqlx::sqlite::SqliteConnection;

use super::effects::{
    CountKey, Effects, NewAnswer, NewArrivalRow, NewEvent, NewLink, NewRunRow, NewStepRow,
};
use super::job::{Arrive, CandidateRun, DrawnStep, Hot, Job, Show, Start, Submit};
use super::load::{self, FoundRun, LoadedArrival, LoadedRun, NextIds, PastForm, Place};
use super::rules::{Body, Closed, EndedBody, KeySeen, SWEEP_SLACK_MS};
use super::runs::ARRIVAL_LIFE_MS;
use super::token::TokenHash;
use super::{
    Change, Error, EventId, EventKind, Receipt, RunId, RunState, Started, StudyState, Submitted,
    Verdict, json,
};
use crate::study::{NotAdmitted, Reply, StudyId, Timestamp};

/// Writes a group of frequent jobs and holds each one's answer on its ticket.
pub(super) async fn write(
    connection: &mut SqliteConnection,
    jobs: &mut [Job],
) -> Result<Vec<Change>, sqlx::Error> {
    let mut batch = Batch::load(connection, jobs).await?;
    let mut next_start = 0;
    for job in jobs {
        match job {
            Job::Hot(Hot::Arrive(arrive, ticket)) => ticket.hold(batch.arrive(arrive)),
            Job::Hot(Hot::Start(start, ticket)) => {
                ticket.hold(batch.start(next_start, start));
                next_start += 1;
            }
            Job::Hot(Hot::Submit(submit, ticket)) => ticket.hold(batch.submit(submit)),
            Job::Hot(Hot::Show(show, ticket)) => ticket.hold(batch.show(show)),
            Job::Hot(Hot::CloseOverdue(now, ticket)) => ticket.hold(Ok(batch.close_overdue(*now))),
            // The writer hands rare jobs to their own functions.
            Job::Rare(_) => {}
        }
    }
    let runs = &batch.runs;
    batch
        .effects
        .write(connection, |run| runs.get(&run).map(|run| &run.facts))
        .await
}

struct Batch {
    next: NextIds,
    studies: HashMap<String, StudyState>,
    /// Those among the arriving people of recruiting platforms who have a run.
    known_people: HashSet<(StudyId, String, String)>,
    /// Those among them who withdrew after their part had ended.
    withdrawn_people: HashSet<(StudyId, String, String)>,
    runs: HashMap<RunId, LoadedRun>,
    overdue: Vec<RunId>,
    past_forms: HashMap<(RunId, String), PastForm>,
    /// By the place of the start among the batch's starts.
    arrivals: HashMap<usize, LoadedArrival>,
    /// How many places are taken, in the studies that count them.
    places: HashMap<Place, u64>,
    /// What this batch has started or resumed, for a second start that follows in it.
    started_links: HashMap<TokenHash, FoundRun>,
    started_people: HashMap<(StudyId, String, String), FoundRun>,
    effects: Effects,
}

impl Batch {
    async fn load(connection: &mut SqliteConnection, jobs: &[Job]) -> Result<Self, sqlx::Error> {
        let mut jobs_by_run: BTreeMap<RunId, u32> = BTreeMap::new();
        let (mut keys, mut starts) = (Vec::new(), Vec::new());
        let (mut has_arrivals, mut overdue) = (false, Vec::new());
        let (mut people, mut counted) = (Vec::new(), BTreeSet::new());
        for job in jobs {
            match job {
                Job::Hot(Hot::Arrive(arrive, _)) => {
                    has_arrivals = true;
                    people.extend(arrive.person());
                }
                Job::Hot(Hot::Start(start, _)) => {
                    starts.push((start.arrival, start.link.hash()));
                    if start.counts_places() {
                        counted.insert((start.study.clone(), start.population));
                    }
                }
                Job::Hot(Hot::Submit(submit, _)) => {
                    *jobs_by_run.entry(submit.run).or_default() += 1;
                    keys.push((submit.run, submit.submission.key.as_str()));
                }
                Job::Hot(Hot::Show(show, _)) => *jobs_by_run.entry(show.run).or_default() += 1,
                Job::Hot(Hot::CloseOverdue(now, _)) => {
                    overdue = load::overdue_runs(connection, *now).await?;
                    for run in &overdue {
                        *jobs_by_run.entry(*run).or_default() += 1;
                    }
                }
                Job::Rare(_) => {}
            }
        }
        let studies = if has_arrivals {
            load::study_states(connection).await?
        } else {
            HashMap::new()
        };
        Ok(Self {
            next: load::next_ids(connection).await?,
            studies,
            known_people: load::known_people(connection, &people).await?,
            withdrawn_people: load::withdrawn_people(connection, &people).await?,
            runs: load::runs(connection, &jobs_by_run).await?,
            overdue,
            past_forms: load::past_forms(connection, &keys).await?,
            arrivals: load::arrivals(connection, &starts).await?,
            places: load::places(connection, &counted).await?,
            started_links: HashMap::new(),
            started_people: HashMap::new(),
            effects: Effects::default(),
        })
    }

    fn arrive(&mut self, arrive: &Arrive) -> Result<(), Error> {
        let state = *self
            .studies
            .get(arrive.study.as_str())
            .ok_or(Error::NotFound("study"))?;
        // Whoever is under way comes back through the same recruiting link, whatever the study's state.
        let has_run = arrive.person().is_some_and(|person| {
            self.known_people.contains(&person) || self.started_people.contains_key(&person)
        });
        if !has_run && !arrive.is_preview {
            require_open(&arrive.study, state)?;
            let has_withdrawn = arrive
                .person()
                .is_some_and(|person| self.withdrawn_people.contains(&person));
            require_not_withdrawn(has_withdrawn)?;
            require_admitted(arrive.refusal.as_ref())?;
        }
        self.effects.arrivals.push(NewArrivalRow {
            token: arrive.token.to_hex(),
            study_id: arrive.study.clone(),
            platform: arrive.platform.clone(),
            platform_key: arrive.platform_key.clone(),
            recruiting: arrive.recruiting.clone(),
            source: arrive.source.clone(),
            language: arrive.language.clone(),
            is_preview: arrive.is_preview,
            at: arrive.at.0,
        });
        Ok(())
    }

    fn start(&mut self, ordinal: usize, start: &Start) -> Result<Started, Error> {
        let arrival = self
            .arrivals
            .get(&ordinal)
            .filter(|arrival| arrival.study == start.study)
            .cloned()
            .ok_or(Error::NotFound("arrival"))?;
        let link = start.link.hash();
        if let Some(own) = self.started_links.get(&link).copied().or(arrival.own) {
            return Ok(resumed(start, own));
        }
        if start.at.0 - arrival.created_at.0 > ARRIVAL_LIFE_MS {
            return Err(Error::NotFound("arrival"));
        }
        let is_preview = arrival.is_preview;
        let person = arrival.platform.clone().zip(arrival.platform_key.clone());
        let person = person
            .filter(|_| !is_preview)
            .map(|(platform, key)| (arrival.study.clone(), platform, key));
        let taken = person
            .as_ref()
            .and_then(|person| self.started_people.get(person).copied().or(arrival.person));
        if let Some(taken) = taken {
            self.link(start, link, taken);
            return Ok(resumed(start, taken));
        }
        let candidate = if is_preview {
            start.candidates.first()
        } else {
            require_open(&arrival.study, arrival.study_state)?;
            require_not_withdrawn(arrival.has_withdrawn)?;
            require_admitted(start.refusal.as_ref())?;
            self.find_place(start)?
        };
        let candidate =
            candidate.ok_or_else(|| Error::Refused("a run needs its steps".to_owned()))?;
        let run = self.begin(start, arrival, candidate, is_preview);
        let found = FoundRun {
            run,
            state: RunState::Active,
            is_owner: true,
        };
        self.link(start, link, found);
        if let Some(person) = person {
            self.started_people.insert(
                person,
                FoundRun {
                    is_owner: false,
                    ..found
                },
            );
        }
        Ok(Started {
            is_resumed: false,
            ..resumed(start, found)
        })
    }

    fn link(&mut self, start: &Start, link: TokenHash, found: FoundRun) {
        self.started_links.insert(link, found);
        self.effects.links.push(NewLink {
            link: link.to_hex(),
            arrival: start.arrival.to_hex(),
            run_id: found.run,
            is_owner: found.is_owner,
            at: start.at.0,
        });
    }

    /// The first candidate of the condition in which the fewest places are taken.
    fn find_place<'s>(&self, start: &'s Start) -> Result<Option<&'s CandidateRun>, Error> {
        let taken: u64 = self
            .places
            .iter()
            .filter(|(place, _)| place.study == start.study && place.population == start.population)
            .map(|(_, taken)| taken)
            .sum();
        if start.quota.is_some_and(|quota| taken >= u64::from(quota)) {
            return Err(Error::NotAdmitted(NotAdmitted::Full));
        }
        Ok(start.candidates.iter().min_by_key(|candidate| {
            let place = place(start, candidate);
            self.places.get(&place).copied().unwrap_or(0)
        }))
    }

    fn begin(
        &mut self,
        start: &Start,
        arrival: LoadedArrival,
        candidate: &CandidateRun,
        is_preview: bool,
    ) -> RunId {
        let run = RunId(self.next.run);
        self.next.run += 1;
        let study = arrival.study;
        self.effects.runs.push(NewRunRow {
            id: run,
            study_id: study.clone(),
            version_id: start.version,
            platform: arrival.platform.filter(|_| !is_preview),
            platform_key: arrival.platform_key.filter(|_| !is_preview),
            recruiting: arrival.recruiting,
            source: arrival.source,
            language: start.language.clone().or(arrival.language),
            is_simulated: start.population.is_simulated(),
            is_preview,
            time_factor: start.factor.get(),
            condition: candidate.condition.clone(),
            expires_at: start
                .time_limit_ms
                .map(|limit_ms| start.at.0.saturating_add(limit_ms)),
            has_times: true,
            at: start.at.0,
        });
        for (position, step) in (0..).zip(&candidate.steps) {
            self.begin_step(run, &study, position, step);
        }
        self.add_event(run, 0, EventKind::Started, start.at);
        if !is_preview {
            if start.counts_places() {
                *self.places.entry(place(start, candidate)).or_default() += 1;
            }
            self.effects
                .populations
                .entry((study, start.population))
                .or_default()
                .started += 1;
        }
        run
    }

    fn begin_step(&mut self, run: RunId, study: &StudyId, position: u32, step: &DrawnStep) {
        if let Some(asked) = &step.asked {
            self.effects.problems.insert((study.clone(), asked.clone()));
        }
        self.effects.steps.push(NewStepRow {
            run_id: run,
            position,
            kind: step.plan.kind.as_str(),
            block: step.plan.block.to_string(),
            question: step.plan.question.as_ref().map(ToString::to_string),
            limit_ms: step.plan.limit_ms,
            study_id: study.clone(),
            cell: step.asked.as_ref().map(|asked| asked.cell.clone()),
            hash: step.asked.as_ref().map(|asked| asked.hash.clone()),
            is_fitted: step.is_fitted,
            is_practice: step.is_practice,
            data: json(&step.plan.data),
        });
    }

    fn submit(&mut self, submit: &Submit) -> Result<Submitted, Error> {
        let run = self
            .runs
            .get_mut(&submit.run)
            .ok_or(Error::NotFound("run"))?;
        let form = (submit.run, submit.submission.key.clone());
        let past = self.past_forms.get(&form).cloned();
        let seen = past
            .as_ref()
            .map_or(KeySeen::Never, |past| past.compare(&submit.body_hash));
        let judgement = run
            .facts
            .submit(&submit.submission, seen, submit.at)
            .map_err(|refusal| Error::Refused(refusal.to_string()))?;
        let (verdict, position) = (judgement.verdict, submit.submission.position);
        if verdict == Verdict::Wrong {
            self.effects.touched.insert(submit.run);
        }
        // An early report of the end does not use the form up: its person may still choose with the same form.
        let keeps_key = past.is_none() && verdict != Verdict::Early;
        let event = self.next_event();
        self.effects.events.push(NewEvent {
            id: event,
            run_id: submit.run,
            position,
            kind: EventKind::Submitted.as_str(),
            key: keeps_key.then(|| submit.submission.key.clone()),
            repeat_of: past.as_ref().map(|past| past.receipt.event),
            body_hash: Some(submit.body_hash.clone()),
            verdict: Some(verdict),
            at: submit.at.0,
            body: Some(submit.body.clone()),
        });
        let receipt = match past {
            Some(past) => past.receipt,
            None => Receipt {
                event,
                position,
                verdict,
                at: submit.at,
            },
        };
        if keeps_key {
            self.past_forms.insert(
                form,
                PastForm {
                    receipt,
                    body_hash: submit.body_hash.clone(),
                },
            );
        }
        if let Some(closed) = &judgement.closed {
            self.close(
                submit.run,
                event,
                closed,
                Some(&Body::of(&submit.submission)),
            );
        }
        if judgement.closed.is_some() && self.runs[&submit.run].facts.state != RunState::Active {
            let finisher = submit.link.map(|link| (submit.run, link.to_hex()));
            self.effects.finishers.extend(finisher);
        }
        if let Some(shown) = judgement.shown {
            self.add_event(submit.run, shown, EventKind::Shown, submit.at);
        }
        let facts = &self.runs[&submit.run].facts;
        Ok(Submitted {
            receipt,
            verdict,
            state: facts.state,
            position: facts.position,
        })
    }

    fn show(&mut self, show: &Show) -> Result<(), Error> {
        let run = self.runs.get_mut(&show.run).ok_or(Error::NotFound("run"))?;
        if let Some(closed) = run.facts.time_out(show.at, 0) {
            // Somebody came back after the end of their time: the page is of the next step then.
            self.run_out(show.run, &closed);
        } else if run.facts.show(show.position, show.at) {
            self.effects.touched.insert(show.run);
            self.add_event(show.run, show.position, EventKind::Shown, show.at);
        }
        Ok(())
    }

    fn close_overdue(&mut self, now: Timestamp) -> usize {
        let mut closed_steps = 0;
        for run in std::mem::take(&mut self.overdue) {
            let Some(facts) = self.runs.get_mut(&run).map(|run| &mut run.facts) else {
                continue;
            };
            let position = facts.position;
            if facts.expire(now) {
                self.end(run, position, now);
                closed_steps += 1;
            } else if let Some(closed) = facts.time_out(now, SWEEP_SLACK_MS) {
                self.run_out(run, &closed);
                closed_steps += 1;
            }
        }
        closed_steps
    }

    /// Keeps that the server ended a run at a step.
    fn end(&mut self, id: RunId, position: u32, at: Timestamp) {
        let state = self.runs[&id].facts.state;
        let event = self.next_event();
        self.effects.events.push(NewEvent {
            id: event,
            run_id: id,
            position,
            kind: EventKind::Ended.as_str(),
            key: None,
            repeat_of: None,
            body_hash: None,
            verdict: None,
            at: at.0,
            body: Some(json(&EndedBody { state })),
        });
        self.effects.touched.insert(id);
        self.effects.ended_alone.push(id);
        if !self.runs[&id].facts.is_preview {
            self.count_state(id);
        }
    }

    fn run_out(&mut self, run: RunId, closed: &Closed) {
        let event = self.add_event(run, closed.position, EventKind::RanOut, closed.at);
        self.close(run, event, closed, None);
        if self.runs[&run].facts.state != RunState::Active {
            self.effects.ended_alone.push(run);
        }
    }

    /// Keeps what a closed step adds: its answer, the counts, the run's new state.
    fn close(&mut self, id: RunId, event: EventId, closed: &Closed, body: Option<&Body>) {
        let run = &self.runs[&id];
        self.effects.touched.insert(id);
        self.effects
            .answers
            .push(NewAnswer::of(event, id, closed, body));
        if run.facts.state == RunState::Completed {
            self.effects.paid.push((id, closed.at));
        }
        if run.facts.is_preview {
            return;
        }
        let action = match body.map(|body| &body.reply) {
            Some(Reply::Chose { action }) => action.to_string(),
            Some(
                Reply::Agreed
                | Reply::AgreedTo { .. }
                | Reply::Declined
                | Reply::Continued
                | Reply::Watched { .. }
                | Reply::GaveUp
                | Reply::Filled { .. },
            )
            | None => String::new(),
        };
        if let Some(problem) = closed.problem.filter(|_| closed.is_counted) {
            let (study, population) = (run.study.clone(), run.population);
            let key = CountKey {
                study,
                population,
                problem,
                status: closed.status,
                action,
            };
            *self.effects.counts.entry(key).or_default() += 1;
        }
        let is_filled = matches!(body.map(|body| &body.reply), Some(Reply::Filled { .. }));
        // Turning a page changes nothing that is shown, so that the versions stay.
        if !closed.is_counted && !is_filled && run.facts.state == RunState::Active {
            return;
        }
        self.count_state(id);
    }

    /// Counts the state that a run has come to, or at least that its study shows something new.
    fn count_state(&mut self, id: RunId) {
        let run = &self.runs[&id];
        let delta = self
            .effects
            .populations
            .entry((run.study.clone(), run.population))
            .or_default();
        let frees_place = match run.facts.state {
            RunState::Active | RunState::Completed => false,
            RunState::Declined
            | RunState::ScreenedOut
            | RunState::FailedCheck
            | RunState::TimedOut
            | RunState::Withdrawn => true,
        };
        if let Some(taken) = run
            .place
            .as_ref()
            .filter(|_| frees_place)
            .and_then(|place| self.places.get_mut(place))
        {
            *taken = taken.saturating_sub(1);
        }
        match run.facts.state {
            RunState::Completed => {
                delta.completed += 1;
                self.effects.completed.push(id);
            }
            RunState::Declined => {
                delta.declined += 1;
                self.effects.declined.push(id);
            }
            RunState::ScreenedOut => delta.screened_out += 1,
            RunState::FailedCheck => delta.failed_check += 1,
            RunState::TimedOut => delta.timed_out += 1,
            RunState::Active | RunState::Withdrawn => {}
        }
    }

    /// Adds an event that nobody sent a form for.
    fn add_event(&mut self, run: RunId, position: u32, kind: EventKind, at: Timestamp) -> EventId {
        let id = self.next_event();
        self.effects.events.push(NewEvent {
            id,
            run_id: run,
            position,
            kind: kind.as_str(),
            key: None,
            repeat_of: None,
            body_hash: None,
            verdict: (kind == EventKind::RanOut).then_some(Verdict::TimedOut),
            at: at.0,
            body: None,
        });
        id
    }

    fn next_event(&mut self) -> EventId {
        let id = EventId(self.next.event);
        self.next.event += 1;
        id
    }
}

fn require_open(study: &StudyId, state: StudyState) -> Result<(), Error> {
    match state {
        StudyState::Open => Ok(()),
        StudyState::Draft | StudyState::Paused | StudyState::Closed => Err(Error::Closed {
            study: study.to_string(),
            state,
        }),
    }
}

fn require_not_withdrawn(has_withdrawn: bool) -> Result<(), Error> {
    if has_withdrawn {
        Err(Error::NotAdmitted(NotAdmitted::Withdrawn))
    } else {
        Ok(())
    }
}

fn require_admitted(refusal: Option<&NotAdmitted>) -> Result<(), Error> {
    refusal.map_or(Ok(()), |reason| Err(Error::NotAdmitted(reason.clone())))
}

fn place(start: &Start, candidate: &CandidateRun) -> Place {
    Place {
        study: start.study.clone(),
        population: start.population,
        condition: candidate.condition.clone(),
    }
}

fn resumed(start: &Start, found: FoundRun) -> Started {
    let FoundRun {
        run,
        state,
        is_owner,
    } = found;
    Started {
        link: start.link.clone(),
        run,
        state,
        is_owner,
        is_resumed: true,
    }
}

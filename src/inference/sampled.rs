//! Draws from a posterior until they can be trusted; `reading` holds what is read off them.

mod reading;

use std::ops::ControlFlow;
use std::sync::Arc;

use rand_chacha::ChaCha12Rng;

use super::diagnostics::{Convergence, NormalScores, Workspace};
use super::lanes::{InstructionSet, Kernel, exp};
use super::likelihood::Predictor;
use super::posterior::Posterior;
use super::sampler::{
    Chains, Cloud, Proposal, Run, Watch, adapt, ln_evidence, random_stream, run_chains, warm_up,
};
use super::summary::Estimate;
use super::{ChoiceData, Draws, FitError, FitSettings, Progress};

/// Steps of the kernel for each kept draw, in the first round; each further round doubles them.
const FIRST_STEPS: usize = 2;

/// Draws at the start of each chain that are not kept, when it starts from a point of a wider density.
const COLD_BURN_IN: usize = 50;

/// The same when it starts from a draw of the posterior before a few more answers, or goes on: as many steps as one cycle has.
const WARM_BURN_IN: usize = 16;

/// Rounds after which a fit that has not converged is given up: 2 + 4 + … + 64 steps for each draw.
const MAX_ROUNDS: u32 = 6;

/// Below this share of accepted proposals the proposal is fitted again, even if the chains agree.
const LOW_ACCEPTANCE: f64 = 0.15;

/// Below this share a warm fit's proposal is fitted again.
const WARM_ACCEPTANCE: f64 = 0.3;

/// Rounds after which a warm fit gives way to a cold one.
const WARM_ROUNDS: u32 = 3;

/// A proposal that is accepted less often than this share of what it was when it was fitted is brought up to date.
const WORN_SHARE: f64 = 0.85;

/// Rounds of expectation maximisation that do so.
const WARM_FIT_ROUNDS: usize = 3;

/// Among so many independent draws neither an R̂ of 1.01 nor an effective sample size of 400 is within reach.
const MANY_DRAWS: usize = 4000;

/// Points that a proposal is fitted to again.
const REFIT_POINTS: usize = 1000;

/// Random streams far above those of chains.
const INERT_STREAM: u64 = 1 << 40;
const EVIDENCE_STREAM: u64 = 1 << 41;
const ADAPTATION_STREAM: u64 = super::sampler::streams::ADAPTATION;

/// What one fit leaves for the next: a proposal, points to start from, and how far apart draws had to be.
#[derive(Debug, Clone)]
pub(super) struct Warm {
    proposal: Proposal,
    points: Cloud,
    steps: usize,
    /// Share of proposals accepted when the proposal was fitted.
    acceptance: f64,
    /// How many warm fits there were since the cold one.
    generation: u64,
    /// They depend on the number of draws alone.
    scores: Arc<NormalScores>,
}

/// Draws whose convergence was judged, with what [`Sampling::finish`] needs to add the rest.
pub(super) struct Judged {
    sampled: Sampled,
    chains: Chains,
    proposal: Proposal,
    steps: usize,
    /// The acceptance when the proposal was fitted, if that was not for these chains.
    fitted: Option<f64>,
    scores: Arc<NormalScores>,
}

/// Draws with all that is read off them.
pub(super) struct Sampled {
    pub(super) draws: Draws,
    /// ln P(a) by draw for every action of every distinct problem, problem after problem.
    ln_predicted: Vec<Vec<f64>>,
    /// The same without the logarithm.
    predicted: Vec<Vec<f64>>,
    /// Of each column of the draws.
    pub(super) convergence: Vec<Convergence>,
    /// Columns whose convergence is not known yet, since it was not in question.
    unmeasured: Vec<usize>,
    /// Of each distinct problem, the worst action's.
    predicted_convergence: Vec<Convergence>,
    pub(super) converged: bool,
    pub(super) sample_indices: Vec<usize>,
    pub(super) steps_per_draw: usize,
    pub(super) acceptance: Option<f64>,
    pub(super) ln_evidence: Option<Estimate>,
    /// Positions to climb from, spread over the draws.
    pub(super) points: Cloud,
    /// Nothing if no parameter moves.
    pub(super) warm: Option<Warm>,
}

/// Draws from a posterior: what stays the same from round to round.
pub(super) struct Sampling<'a> {
    pub(super) posterior: &'a mut Posterior,
    pub(super) predictor: &'a mut Predictor,
    pub(super) data: &'a ChoiceData,
    pub(super) settings: &'a FitSettings,
    /// Of the fit that is made: 0 when it is cold.
    pub(super) generation: u64,
    /// For diagnostics.
    pub(super) workspace: Workspace,
}

impl Sampling<'_> {
    /// Warms up, runs chains, and runs them on until they have converged or the bound is reached.
    pub(super) fn cold(
        &mut self,
        watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<Judged, FitError> {
        let seed = self.settings.seed;
        let scores = Arc::new(self.scores());
        let mut warming: Box<Watch<'_>> = Box::new(|| watch(Progress::WarmingUp));
        let warm = warm_up(self.posterior, seed, &mut warming)?;
        self.generation = 0;
        let mut rng = self.stream(ADAPTATION_STREAM, 0);
        let mut proposal = adapt(
            self.posterior,
            warm.proposal.clone(),
            &mut rng,
            &mut warming,
        )?;
        drop(warming);
        let mut starts = warm.starts(self.settings.chains);
        let mut steps = FIRST_STEPS;
        let mut round = 0;
        loop {
            round += 1;
            let chains = self.run(&proposal, &starts, COLD_BURN_IN, steps, round, watch)?;
            let satisfies = chains.acceptance >= LOW_ACCEPTANCE;
            let is_last = round == MAX_ROUNDS;
            if let Some(sampled) = self.read(&chains, &scores, round, satisfies, is_last) {
                return Ok(Judged {
                    sampled,
                    chains,
                    proposal,
                    steps,
                    fitted: None,
                    scores,
                });
            }
            // Warm-up points stay in: chains that miss a mode must not teach the proposal to miss it too.
            let mut points = warm.points.clone();
            points.extend(&chains.thinned(REFIT_POINTS));
            proposal = Proposal::fit(&points, 16, seed.wrapping_add(u64::from(round)));
            proposal = adapt(self.posterior, proposal, &mut rng, &mut || {
                watch(Progress::Sampling { round })
            })?;
            starts = chains.ends();
            steps *= 2;
        }
    }

    /// Runs chains from where an earlier fit ended. Nothing if that does not serve: the proposal hardly fits, or the
    /// chains do not converge.
    pub(super) fn warm(
        &mut self,
        earlier: &Warm,
        watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<Option<Judged>, FitError> {
        self.generation = earlier.generation + 1;
        let scores = Arc::clone(&earlier.scores);
        let stride = (earlier.points.len() / self.settings.chains).max(1);
        let start = |chain: usize| earlier.points.point(chain * stride % earlier.points.len());
        let mut starts: Vec<Vec<f64>> = (0..self.settings.chains).map(start).collect();
        let mut proposal = earlier.proposal.clone();
        let mut steps = earlier.steps.div_ceil(2);
        let mut fitted = Some(earlier.acceptance);
        for round in 1..=WARM_ROUNDS {
            let chains = self.run(&proposal, &starts, WARM_BURN_IN, steps, round, watch)?;
            let satisfies = chains.acceptance >= WARM_ACCEPTANCE;
            if let Some(sampled) = self.read(&chains, &scores, round, satisfies, false) {
                return Ok(Some(Judged {
                    sampled,
                    chains,
                    proposal,
                    steps,
                    fitted,
                    scores,
                }));
            }
            if satisfies {
                steps *= 2;
            } else {
                let mut rng = self.stream(ADAPTATION_STREAM, round);
                proposal = adapt(self.posterior, proposal, &mut rng, &mut || {
                    watch(Progress::Sampling { round })
                })?;
                fitted = None;
            }
            starts = chains.ends();
        }
        Ok(None)
    }

    /// A stream of random numbers for one purpose. Each warm fit has its own: where it starts and what it proposes come
    /// from the draws before it, which must not be functions of the numbers that drive it.
    fn stream(&self, purpose: u64, round: u32) -> ChaCha12Rng {
        let number = self.generation_bits() + purpose + u64::from(round);
        random_stream(self.settings.seed, number)
    }

    /// Above the bits of all purposes and rounds; after 65,536 warm fits they begin again.
    fn generation_bits(&self) -> u64 {
        self.generation << 48
    }

    /// The scores of ranks among as many draws as half chains have.
    fn scores(&self) -> NormalScores {
        NormalScores::new(self.settings.chains * (self.settings.draws / 2 * 2))
    }

    fn run(
        &mut self,
        proposal: &Proposal,
        starts: &[Vec<f64>],
        burn_in: usize,
        steps: usize,
        round: u32,
        watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<Chains, FitError> {
        let run = Run {
            seed: self.settings.seed,
            stream: self.generation_bits() + (u64::from(round) << 32),
            burn_in,
            draws: self.settings.draws,
            steps,
        };
        let mut watch = || watch(Progress::Sampling { round });
        Ok(run_chains(
            self.posterior,
            proposal,
            starts,
            run,
            &mut watch,
        )?)
    }

    /// What chains say, if they satisfy or are the last.
    fn read(
        &mut self,
        chains: &Chains,
        scores: &NormalScores,
        round: u32,
        satisfies: bool,
        is_last: bool,
    ) -> Option<Sampled> {
        if !satisfies && !is_last {
            return None;
        }
        let mut rng = self.stream(INERT_STREAM, round);
        let draws = self.posterior.draws(chains, &mut rng);
        self.judge(draws, scores, is_last)
    }

    /// What draws say; nothing if they have not converged, unless they are the last.
    fn judge(&mut self, draws: Draws, scores: &NormalScores, is_last: bool) -> Option<Sampled> {
        let Self {
            predictor,
            data,
            settings,
            workspace,
            ..
        } = self;
        let mut agree = true;
        let mut convergence = Vec::with_capacity(draws.columns.len());
        let mut unmeasured = Vec::new();
        for (index, (quantity, values)) in draws.columns.iter().enumerate() {
            if draws.len() >= MANY_DRAWS && self.posterior.is_drawn_from_prior(*quantity) {
                unmeasured.push(index);
                convergence.push(Convergence::NONE);
                continue;
            }
            let found = workspace.order(&draws.by_chain(values)).convergence(scores);
            agree &= found.is_converged();
            if !agree && !is_last {
                return None;
            }
            convergence.push(found);
        }
        let ln_predicted = predictor.of_draws(&draws);
        let mut sampled = Sampled {
            predicted: InstructionSet::widest().run(Exponentials(&ln_predicted)),
            ln_predicted,
            draws,
            convergence,
            unmeasured,
            predicted_convergence: Vec::new(),
            converged: false,
            sample_indices: Vec::new(),
            steps_per_draw: 1,
            acceptance: None,
            ln_evidence: None,
            points: Cloud::new(Vec::new()),
            warm: None,
        };
        for range in predictor.distinct_ranges() {
            let found = sampled.problem_convergence(scores, workspace, range);
            agree &= found.is_converged();
            if !agree && !is_last {
                return None;
            }
            sampled.predicted_convergence.push(found);
        }
        sampled.sample_indices = sampled.spaced_samples(settings.samples);
        let spacing = settings.draws as f64 / settings.samples.div_ceil(settings.chains) as f64;
        let moves = |quantity| !self.posterior.is_drawn_from_prior(quantity);
        let needed = sampled.needed_spacing(workspace, moves, data, predictor);
        sampled.converged = agree && spacing >= needed;
        (sampled.converged || is_last).then_some(sampled)
    }

    /// Adds what no statement about convergence needs: the evidence, and what the next fit starts from.
    pub(super) fn finish(&mut self, judged: Judged) -> Sampled {
        let Judged {
            mut sampled,
            chains,
            mut proposal,
            steps,
            fitted,
            scores,
        } = judged;
        sampled.measure_prior_draws(&mut self.workspace, &scores);
        let mut rng = self.stream(EVIDENCE_STREAM, 0);
        let draws = self.settings.chains * self.settings.draws;
        let (value, se) = ln_evidence(self.posterior, &proposal, draws, &mut rng);
        sampled.ln_evidence =
            (value.is_finite() && se.is_finite()).then_some(Estimate { value, se });
        sampled.steps_per_draw = steps;
        sampled.acceptance = Some(chains.acceptance);
        let points = chains.thinned(REFIT_POINTS);
        sampled.points = points.clone();
        let mut acceptance = fitted.unwrap_or(chains.acceptance);
        if chains.acceptance < WORN_SHARE * acceptance {
            proposal = proposal.refit(&points, WARM_FIT_ROUNDS);
            acceptance = chains.acceptance;
        }
        sampled.warm = Some(Warm {
            proposal,
            points,
            steps,
            acceptance,
            generation: self.generation,
            scores,
        });
        sampled
    }

    /// When choices say nothing: independent draws from the prior.
    pub(super) fn prior(&mut self) -> Sampled {
        let chains = Chains {
            chains: self.settings.chains,
            per_chain: self.settings.draws,
            coordinates: Vec::new(),
            acceptance: 1.0,
        };
        let scores = self.scores();
        let mut sampled = self
            .read(&chains, &scores, 0, true, true)
            .expect("what is last is read");
        sampled.measure_prior_draws(&mut self.workspace, &scores);
        // Nothing depends on the parameters, the likelihood least of all.
        sampled.ln_evidence = Some(Estimate {
            value: self.posterior.ln_likelihood_at_random(),
            se: 0.0,
        });
        sampled
    }
}

/// e to the power of each value of each column.
struct Exponentials<'a>(&'a [Vec<f64>]);

impl Kernel for Exponentials<'_> {
    type Output = Vec<Vec<f64>>;

    #[inline(always)]
    fn run(self) -> Vec<Vec<f64>> {
        let mut powers = self.0.to_vec();
        for column in &mut powers {
            for value in column {
                *value = exp(*value);
            }
        }
        powers
    }
}

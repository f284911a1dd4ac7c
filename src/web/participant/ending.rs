//! The last page of a run: its code, its bonus, and the way back to the site that sent the person.

use axum::{
    Extension,
    response::{IntoResponse, Response},
};

use super::{
    pages::{
        BonusText, ExternalSubmit, LaterWithdrawal, Outcome, PaidChoiceText, ThanksPage, WayBack,
    },
    run::RunPages,
};
use crate::{
    store::{PaidChoice, RunView, Token},
    study::{Bonus, CompletionCode, Ending, LinkParameter, Step, StepPlan, Study, Timestamp},
    web::{Error, headers::SubmitsTo},
};

impl RunPages {
    /// The address under which a run can be withdrawn later, in full where the server knows its own.
    fn withdrawal_address(&self, token: &Token) -> String {
        let path = format!("/r/{token}/withdraw");
        match &self.settings.public_url {
            Some(url) => format!("{}{path}", url.to_string().trim_end_matches('/')),
            None => path,
        }
    }

    /// The page of a run that has ended. Its code is shown only after the stored answers were counted, and only to the
    /// links on which the run was started or finished; so is its bonus.
    pub(super) async fn ended(
        &self,
        token: &Token,
        run: &RunView,
        study: &Study,
        ending: Ending,
    ) -> Result<Response, Error> {
        let page = study.ending(ending);
        let stored = self.store.stored_count(run.run).await?;
        // A run whose time was over may have ended before its first answer.
        let ended_before_all = ending == Ending::TimedOut && stored.is_empty();
        if !(stored.is_complete() || ended_before_all) {
            return Err(Error::Internal(anyhow::anyhow!(
                "run {} has ended but has {} answers for {} steps",
                run.run,
                stored.answers,
                stored.steps
            )));
        }
        let outcome = if run.shows_code {
            let code = match &page.code {
                CompletionCode::Fixed(code) => Some(code.clone()),
                CompletionCode::PerRun => Some(self.store.completion_code(run.run)),
                CompletionCode::Absent => None,
            };
            Outcome::Finished {
                way_back: self.way_back(run, study, ending, code.as_deref()).await?,
                code,
                stored: stored.answers,
                bonus: self.bonus(run, study).await?.map(Box::new),
            }
        } else {
            Outcome::AlreadyTaken
        };
        let submits_to = outcome.is_submitted().then(|| {
            let sites = study.recruiting().mturk.submitting_sites();
            SubmitsTo(sites.into_iter().map(str::to_owned).collect())
        });
        let page = ThanksPage {
            words: study.words(),
            token,
            ending: page,
            outcome,
            is_preview: run.is_preview,
            code_label: match ending {
                Ending::Completed => &study.words().completion_code,
                Ending::ScreenedOut | Ending::FailedCheck | Ending::TimedOut => {
                    &study.words().other_code
                }
            },
            contact: study.contact(),
            withdrawal: run.is_owner.then(|| LaterWithdrawal {
                address: self.withdrawal_address(token),
                // The day that ends when the retention time does.
                until: study
                    .recruiting()
                    .retention
                    .map(|retention| study.words().day_of(Timestamp(retention.0 - 1))),
            }),
        };
        Ok(match submits_to {
            Some(sites) => (Extension(sites), page).into_response(),
            None => page.into_response(),
        })
    }

    /// How somebody who has finished gets back to the site that sent them: to MTurk by a form, where the link named the
    /// assignment and who takes it; elsewhere by the study's link.
    async fn way_back(
        &self,
        run: &RunView,
        study: &Study,
        ending: Ending,
        code: Option<&str>,
    ) -> Result<Option<WayBack>, Error> {
        let came_with = self.store.recruiting_parameters(run.run).await?;
        let parameter = |named: LinkParameter| came_with.get(named.name());
        let assignment = parameter(LinkParameter::MturkAssignment);
        let site = parameter(LinkParameter::MturkSubmitTo)
            .and_then(|site| study.recruiting().mturk.taking_site(site).ok());
        if let (Some(assignment), Some(site)) = (assignment, site) {
            return Ok(Some(WayBack::Submit(ExternalSubmit {
                site: site.to_owned(),
                assignment: assignment.clone(),
                ending: ending.as_str(),
            })));
        }
        let target = study.ending(ending).redirect.as_ref();
        let address = target.and_then(|target| target.address(code, &came_with));
        Ok(address.map(WayBack::Link))
    }

    /// What is paid beside the fee, and which choice it comes from.
    async fn bonus(&self, run: &RunView, study: &Study) -> Result<Option<BonusText>, Error> {
        let Some(terms) = study.bonus() else {
            return Ok(None);
        };
        let Some(bonus) = self.store.bonus(run.run).await? else {
            return Ok(None);
        };
        let choice = match &bonus.choice {
            Some(choice) => {
                let plan = self.store.step(run.run, choice.position).await?;
                paid_choice(study, &plan, choice, terms)?
            }
            None => None,
        };
        Ok(Some(BonusText {
            amount: terms.format(bonus.amount),
            choice,
        }))
    }
}

fn paid_choice(
    study: &Study,
    plan: &StepPlan,
    paid: &PaidChoice,
    terms: &Bonus,
) -> Result<Option<PaidChoiceText>, Error> {
    let Step::Choice(question) = study.step(plan)? else {
        return Ok(None);
    };
    let action = question
        .actions
        .iter()
        .find(|action| action.id == *paid.action)
        .map_or_else(|| paid.action.clone(), |action| action.label.clone());
    Ok(Some(PaidChoiceText {
        question: question.title.to_owned(),
        place: study.words().bonus_question(question.number, question.of),
        action,
        reward: study.reward_unit().format(paid.reward),
        sum: study
            .words()
            .bonus_sum(terms, paid.reward, study.reward_unit()),
    }))
}

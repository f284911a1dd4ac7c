-- The researcher's side: drafts, conditions and places, bonuses, previews, accounts, tokens, and the log of who did what.
--
-- Lists of states and kinds leave the schema with the tables that are copied here: they stand in the program alone, as
-- those of steps do since schema 3, so that a new state copies no table.

create table study_in_any_state (
    id text primary key,
    state text not null,
    -- The version that new runs get. Empty only inside the transaction that creates the study.
    version_id integer references study_version (id),
    -- Whether aggregates may be seen without an account.
    is_public integer not null default 0 check (is_public in (0, 1))
) strict, without rowid;

insert into study_in_any_state (id, state, version_id)
select id, state, version_id
from study;

drop table study;
alter table study_in_any_state rename to study;

-- Which of its study's versions it is, from 1: ids count the versions of all studies.
alter table study_version add column number integer not null default 0;
update study_version
set number = (
    select count(*)
    from study_version as earlier
    where earlier.study_id = study_version.study_id and earlier.id <= study_version.id
);
create unique index study_version_number on study_version (study_id, number);

alter table population add column screened_out integer not null default 0 check (screened_out >= 0);
alter table population add column failed_check integer not null default 0 check (failed_check >= 0);
alter table population add column timed_out integer not null default 0 check (timed_out >= 0);
-- The data version of the last withdrawal: what was computed from data before it is not stored any more.
alter table population add column erased_version integer not null default 0;

-- A look at a study that is never counted is one from its link on. The language is the one of the link or the browser.
alter table arrival add column is_preview integer not null default 0 check (is_preview in (0, 1));
alter table arrival add column language text;

-- Where the server ends a run, the newest link is the one that its person went on with: it shows the ending.
alter table run_token add column made_at_ms integer not null default 0;

create table run_in_any_state (
    id integer primary key,
    study_id text not null references study (id),
    version_id integer not null references study_version (id),
    state text not null,
    -- The first step that is not closed, with its clocks. They stand here and not at the step, so that an answer
    -- rewrites one short row and a step is written once.
    position integer not null check (position >= 0),
    shown_at_ms integer,
    -- The last moment at which an answer to a timed question counts: fixed when the question is first shown.
    deadline_ms integer,
    -- How often the current step was answered wrongly, where it is a check that may be tried again.
    attempts integer not null default 0 check (attempts >= 0),
    platform text,
    -- A keyed hash of the id that the recruiting platform gave to the person.
    platform_key text,
    recruiting text,
    source text,
    language text,
    -- The levels of the between-subjects factors, joined by /. Empty in a study without such factors.
    condition text,
    is_simulated integer not null check (is_simulated in (0, 1)),
    is_preview integer not null check (is_preview in (0, 1)),
    time_factor real not null check (time_factor >= 1),
    -- Whether it is known when things happened. An import may bring answers without times: then all moments are that of the
    -- import, from which how long a question took is counted back.
    has_times integer not null default 1 check (has_times in (0, 1)),
    started_at_ms integer not null,
    -- When an unfinished run gives its place back. Empty where the study sets no end.
    expires_at_ms integer,
    finished_at_ms integer,
    check (state <> 'withdrawn' or (platform is null and platform_key is null and recruiting is null))
) strict;

insert into run_in_any_state (
    id, study_id, version_id, state, position, shown_at_ms, deadline_ms, platform, platform_key, recruiting, source,
    is_simulated, is_preview, time_factor, started_at_ms, finished_at_ms
)
select
    id, study_id, version_id, state, position, shown_at_ms, deadline_ms, platform, platform_key, recruiting, source,
    is_simulated, is_preview, time_factor, started_at_ms, finished_at_ms
from run;

drop table run;
alter table run_in_any_state rename to run;

-- One take per recruited person.
create unique index run_of_person on run (study_id, platform, platform_key)
    where platform_key is not null and state <> 'withdrawn' and is_preview = 0;
create index run_of_study on run (study_id, is_simulated, id);
-- What the sweep of abandoned questions looks for: at most one entry per person who is at a timed question now.
create index run_deadline on run (deadline_ms) where deadline_ms is not null;
-- What the sweep of abandoned runs looks for.
create index run_expiry on run (expires_at_ms) where expires_at_ms is not null and state = 'active';
-- Places that are taken, by condition: counted whenever somebody starts.
create index run_place on run (study_id, is_simulated, condition)
    where state in ('active', 'completed') and is_preview = 0;

-- Who took part to an end and withdrew then: nobody gets a second try by it. Only the keyed hash under which the person was
-- known is kept, until the retention date, and nothing that leads to a run.
create table withdrawn_person (
    study_id text not null references study (id),
    platform_key text not null,
    -- Under which they took part: its retention date is the one that they agreed to.
    version_id integer not null references study_version (id),
    primary key (study_id, platform_key)
) strict, without rowid;

create table event_of_any_kind (
    id integer primary key,
    run_id integer not null references run (id),
    position integer not null,
    kind text not null,
    -- The key of the form that was sent. Empty for a repetition of a key, which names the first event instead.
    key text,
    repeat_of integer references event (id),
    body_hash blob,
    verdict text,
    at_ms integer not null,
    body text
) strict;

insert into event_of_any_kind (id, run_id, position, kind, key, repeat_of, body_hash, verdict, at_ms, body)
select id, run_id, position, kind, key, repeat_of, body_hash, verdict, at_ms, body
from event;

drop table event;
alter table event_of_any_kind rename to event;

-- Serves three purposes: a key counts once in a run, a retry finds its first event, a withdrawal finds all events.
create unique index event_of_run on event (run_id, key);
-- Else the foreign key would search the whole table for each event that a withdrawal deletes.
create index event_repeated on event (repeat_of) where repeat_of is not null;

-- A withdrawal removes the fits that counted the person. An id is never used again, else a reader that knows the old fit
-- would take the new one for it.
create table fit_with_own_ids (
    id integer primary key autoincrement,
    study_id text not null references study (id),
    is_simulated integer not null check (is_simulated in (0, 1)),
    plan text not null,
    part text not null,
    model text not null,
    -- The hash of everything that the result depends on, so that an unchanged part is not fitted again.
    input_hash text not null,
    data_version integer not null,
    version_id integer not null references study_version (id),
    seed integer not null,
    program_version text not null,
    state text not null,
    -- How many fits of this input there were, this one included: bounds the retries.
    attempts integer not null check (attempts >= 1),
    result text,
    draws blob,
    message text,
    created_at_ms integer not null,
    cpu_ms integer not null check (cpu_ms >= 0),
    is_provisional integer not null default 0 check (is_provisional in (0, 1)),
    check ((state = 'failed') = (result is null))
) strict;

insert into fit_with_own_ids (
    id, study_id, is_simulated, plan, part, model, input_hash, data_version, version_id, seed, program_version, state,
    attempts, result, draws, message, created_at_ms, cpu_ms, is_provisional
)
select
    id, study_id, is_simulated, plan, part, model, input_hash, data_version, version_id, seed, program_version, state,
    attempts, result, draws, message, created_at_ms, cpu_ms, is_provisional
from fit;

drop table fit;
alter table fit_with_own_ids rename to fit;
create index fit_history on fit (study_id, is_simulated, plan, part, model, id);

-- What a finished person is paid beside the fee: one of their choices, drawn after the last answer, is played out.
create table bonus (
    run_id integer primary key references run (id),
    -- The choice that was drawn. Empty where there was none to draw from, and the endowment alone is paid.
    position integer,
    action text,
    -- The outcome that was drawn of that action's outcomes.
    reward real,
    -- What it comes to in the bonus's currency.
    amount real not null,
    drawn_at_ms integer not null
) strict;

-- Whom a version of a study leaves out of its analysis: flags and the attention checks that they look at, as JSON. Empty
-- where it leaves out nobody.
alter table study_version add column exclusion text;

-- Who is left out of the analysis: by the rule of their study version, judged when their run ended, or by hand.
create table exclusion (
    run_id integer primary key references run (id),
    -- The flags of the rule that the run has, joined by spaces.
    flags text,
    -- Why they are left out by hand, who did it and when.
    reason text,
    actor text,
    at_ms integer,
    check (flags is not null or reason is not null),
    check ((reason is null) = (actor is null) and (reason is null) = (at_ms is null))
) strict;

-- Counters hold everybody, and beside that what is left out of them.
alter table counter add column excluded_all integer not null default 0
    check (excluded_all between 0 and n_all);
alter table counter add column excluded_completed integer not null default 0
    check (excluded_completed between 0 and n_completed);
alter table population add column excluded integer not null default 0 check (excluded >= 0);
alter table population add column excluded_completed integer not null default 0
    check (excluded_completed between 0 and completed);
-- The data version of the last exclusion by hand, or of its undoing: looks at the people before it are made anew.
alter table population add column exclusion_version integer not null default 0;

create table account (
    id integer primary key,
    name text not null unique,
    -- Argon2id in PHC form.
    password_hash text not null,
    role text not null,
    -- Whether the password was chosen by somebody else and is only good for choosing another one.
    must_change_password integer not null default 0 check (must_change_password in (0, 1)),
    created_at_ms integer not null,
    -- Since when it opens nothing any more. An account is never removed, because the log names it.
    disabled_at_ms integer
) strict;

-- The one-time link with which the first account is made. One row while no account exists.
create table setup_link (
    id integer primary key check (id = 1),
    token_hash blob not null check (length(token_hash) = 32),
    created_at_ms integer not null
) strict;

create table session (
    token_hash blob primary key check (length(token_hash) = 32),
    account_id integer not null references account (id),
    created_at_ms integer not null,
    last_used_at_ms integer not null,
    expires_at_ms integer not null
) strict, without rowid;
create index session_of_account on session (account_id);

create table api_token (
    id integer primary key,
    -- What it is for, in its maker's words.
    name text not null,
    token_hash blob not null unique check (length(token_hash) = 32),
    -- Names joined by spaces.
    scopes text not null,
    account_id integer references account (id),
    created_at_ms integer not null,
    expires_at_ms integer not null,
    revoked_at_ms integer,
    last_used_at_ms integer
) strict;

-- Who exported, changed, erased or looked at what, when, and whether they were let. Only appended to.
create table audit (
    id integer primary key,
    at_ms integer not null,
    -- An account's or token's name, `command` for a command on this machine, or `nobody`.
    actor text not null,
    action text not null,
    study_id text,
    detail text,
    outcome text not null
) strict;

create trigger audit_is_never_changed before update on audit
begin
    select raise(abort, 'the audit log is only appended to');
end;
create trigger audit_is_never_shortened before delete on audit
begin
    select raise(abort, 'the audit log is only appended to');
end;

-- The program that drew and judged a run. Unknown of runs before this schema, and of answers that were given elsewhere.
alter table run add column program_version text;

-- A question under another time limit is another problem: its hash ends with a colon and the limit in milliseconds. What
-- earlier programs stored under one hash is told apart by the limits of the steps that asked it.
create temporary table asked_under as
select
    problem_id, ifnull(limit_ms, 0) as limit_ms,
    row_number() over (partition by problem_id order by ifnull(limit_ms, 0)) as number
from step
where problem_id is not null
group by problem_id, ifnull(limit_ms, 0);

insert into problem (study_id, cell, hash, prospects)
select problem.study_id, problem.cell, problem.hash || ':' || asked_under.limit_ms, problem.prospects
from asked_under
join problem on problem.id = asked_under.problem_id
where asked_under.number > 1;

update step
set problem_id = (
    select own.id
    from problem as pooled
    join problem as own
        on own.study_id = pooled.study_id
        and own.cell = pooled.cell
        and own.hash = pooled.hash || ':' || step.limit_ms
    where pooled.id = step.problem_id
)
where (problem_id, limit_ms) in (select problem_id, limit_ms from asked_under where number > 1);

delete from counter
where problem_id in (select problem_id from asked_under where number > 1);

update answer
set problem_id = (
    select step.problem_id
    from step
    where step.run_id = answer.run_id and step.position = answer.position
)
where problem_id in (select problem_id from asked_under where number > 1);

insert into counter (study_id, is_simulated, problem_id, status, action, n_all, n_completed)
select
    run.study_id, run.is_simulated, answer.problem_id, answer.status, ifnull(answer.action, ''), count(*),
    sum(run.state = 'completed')
from answer
join run on run.id = answer.run_id
where answer.is_counted = 1
and answer.problem_id in (
    select step.problem_id
    from step
    join problem on problem.id = step.problem_id
    where problem.hash like '%:%'
    union
    select problem_id
    from asked_under
    where number > 1
)
group by 1, 2, 3, 4, 5;

update problem
set hash = hash || ':' || asked_under.limit_ms
from asked_under
where asked_under.problem_id = problem.id
and asked_under.number = 1
and asked_under.limit_ms > 0;

drop table asked_under;

-- Whether a text came with the program and no file of the lab's ever had it: only such a one is replaced when a program brings
-- another text. Earlier programs did not note it; their texts are known by their hashes.
alter table study_version add column is_built_in integer not null default 0 check (is_built_in in (0, 1));
update study_version
set is_built_in = 1
where hash in (
    -- driving
    'b56952dfc65950b49f09cff16224cd3a83fd138d1ffa744553b01946eb4b4bdd',
    'b1960f9c4e3ab3d8be7c00ebfb0a77e43485cd086413c4b58bcc96de80536541',
    'fcb33d5740d91ef01b6a68725639669612c7d27b8e8c8a1b5b7240bc7fa9e100',
    '10bb7197be515615a49a67b487999ad310053ca0794ec5d43c6bc0b6b38089c0',
    '7380e9b3afee92b5eed37dc6a276fc9428a48ecd8c87b0c115800c7ee7acc9fd',
    '6737d43659d183b7c70ce74fdc6e14a850128913592bbd5226ba4bcd8b37ff18',
    'd6355ec490b211f6dddf7089c514b2fd8238d3d1cfc186419fb21ec75a79c231',
    '212db9c302a5d1802c6ba2022801f7fdfed976b7885a9d85a01ebddda946c1bc',
    -- cups
    '7f6737768b680c78c59d57dedeceb8d69ff1a7847a1218e288554258ddac2a3f',
    'a018d9a92a1b146098b3edd1c2d6a84801bb1ad994944b0b89efdbc13ca504bb',
    '5c82f13ea0cf14f145b2f0c7607bc0fc4373906fdd869f9907cd96eeb8df36d7',
    '46a3a25c33444ad7b7948d6bc63e5f067d30956f4fe18e3b27e094b36c092e9f'
);

-- Withdrawals under earlier schemas left more than they do now: whatever could tell who it was by a clock goes.
update run
set
    source = null, time_factor = 1, started_at_ms = started_at_ms - started_at_ms % 86400000,
    finished_at_ms = finished_at_ms - finished_at_ms % 86400000
where state = 'withdrawn';
update arrival
set source = null, created_at_ms = created_at_ms - created_at_ms % 86400000
where run_id in (select id from run where state = 'withdrawn');
update event
set at_ms = at_ms - at_ms % 86400000
where kind = 'erased';

-- Those of a study that started nothing, by age: a limited number of them is kept.
create index arrival_unused_of_study on arrival (study_id, created_at_ms) where run_id is null;

-- What was done with a study is listed on its page, however long the log has become.
create index audit_of_study on audit (study_id, id) where study_id is not null;

-- Studies, the runs of people through them, what they answered, and the fits of the models to it.
--
-- Rules that hold for every table:
-- * STRICT: a number never turns into a text unseen.
-- * No "on delete cascade": only a withdrawal removes anything about a person, and it names each table it empties.
-- * Times are integer milliseconds since 1970 (UTC), because texts of varying precision sort wrongly.
-- * JSON is stored as text, because it is read by people with the sqlite3 shell as well.

-- What this database shares with no other: the key of its keyed hashes (links of runs, ids of recruiting platforms).
-- One row, so that nobody can add a second key under which the same person would count as another.
create table server (
    id integer primary key check (id = 1),
    secret blob not null check (length(secret) = 32),
    created_at_ms integer not null
) strict;

create table study (
    id text primary key,
    state text not null check (state in ('open', 'paused', 'closed')),
    -- The version that new runs get. Empty only inside the transaction that creates the study.
    version_id integer references study_version (id)
) strict, without rowid;

-- The full text of each study file that was ever served: a run is read with the version under which it began.
create table study_version (
    id integer primary key,
    study_id text not null references study (id),
    hash text not null,
    text text not null,
    program_version text not null,
    created_at_ms integer not null,
    unique (study_id, hash)
) strict;

-- What a question put before a person, by its content: a changed fine is another problem with counts of its own,
-- while a corrected typing error in a study file keeps the counts.
create table problem (
    id integer primary key,
    study_id text not null references study (id),
    -- The cell's id, or block:question for a question outside the design.
    cell text not null,
    hash text not null,
    -- Each action's outcomes; null where the question withholds them.
    prospects text,
    unique (study_id, cell, hash)
) strict;

-- The totals of one study in one population. Real and simulated people are never added up.
-- data_version moves with every change of the data, page_version also with every new fit.
create table population (
    study_id text not null references study (id),
    is_simulated integer not null check (is_simulated in (0, 1)),
    started integer not null default 0 check (started >= 0),
    completed integer not null default 0 check (completed >= 0),
    declined integer not null default 0 check (declined >= 0),
    withdrawn integer not null default 0 check (withdrawn >= 0),
    data_version integer not null default 0,
    page_version integer not null default 0,
    primary key (study_id, is_simulated)
) strict, without rowid;

-- One passage of one person through a study. Never deleted: a withdrawal leaves a row without anything personal.
create table run (
    id integer primary key,
    study_id text not null references study (id),
    version_id integer not null references study_version (id),
    state text not null check (state in ('active', 'completed', 'declined', 'withdrawn')),
    -- The first step that is not closed, with its clocks. They stand here and not at the step, so that an answer
    -- rewrites one short row and a step is written once.
    position integer not null check (position >= 0),
    shown_at_ms integer,
    -- The last moment at which an answer to a timed question counts: fixed when the question is first shown.
    deadline_ms integer,
    platform text,
    -- A keyed hash of the id that the recruiting platform gave to the person.
    platform_key text,
    recruiting text,
    source text,
    is_simulated integer not null check (is_simulated in (0, 1)),
    is_preview integer not null check (is_preview in (0, 1)),
    time_factor real not null check (time_factor >= 1),
    started_at_ms integer not null,
    finished_at_ms integer,
    check (state <> 'withdrawn' or (platform is null and platform_key is null and recruiting is null))
) strict;

-- One take per recruited person.
create unique index run_of_person on run (study_id, platform, platform_key)
    where platform_key is not null and state <> 'withdrawn' and is_preview = 0;
create index run_of_study on run (study_id, is_simulated, id);
-- What the sweep of abandoned questions looks for: at most one entry per person who is at a timed question now.
create index run_deadline on run (deadline_ms) where deadline_ms is not null;

-- Links that open a run. Only the hash of a link's token is known here.
create table run_token (
    token_hash blob primary key check (length(token_hash) = 32),
    run_id integer not null references run (id),
    -- The link of the one who started it. Another link of the same recruited person may go on, but not withdraw.
    is_owner integer not null check (is_owner in (0, 1)),
    -- The link on which the last step was answered: it shows the completion code too.
    is_finisher integer not null default 0 check (is_finisher in (0, 1))
) strict, without rowid;
create index run_token_of_run on run_token (run_id);

-- Somebody followed a link to a study. Nothing is drawn and no place is taken until they press the button.
create table arrival (
    token_hash blob primary key check (length(token_hash) = 32),
    study_id text not null references study (id),
    platform text,
    platform_key text,
    recruiting text,
    source text,
    created_at_ms integer not null,
    run_id integer references run (id)
) strict, without rowid;
create index arrival_of_run on arrival (run_id) where run_id is not null;
create index arrival_unused on arrival (created_at_ms) where run_id is null;

-- The steps of a run, drawn at its start and never changed.
create table step (
    run_id integer not null references run (id),
    position integer not null check (position >= 0),
    kind text not null check (kind in ('consent', 'info', 'choice', 'form', 'thanks')),
    block text not null,
    question text,
    limit_ms integer check (limit_ms > 0),
    -- Set for choices that are counted or could be; empty for practice and for all other kinds.
    problem_id integer references problem (id),
    is_fitted integer not null check (is_fitted in (0, 1)),
    is_practice integer not null check (is_practice in (0, 1)),
    data text not null,
    primary key (run_id, position),
    check (limit_ms is null or kind = 'choice'),
    check (is_fitted = 0 or problem_id is not null),
    -- A choice that is no practice belongs to a problem; so a start that names an unknown one fails.
    check ((problem_id is not null) = (kind = 'choice' and is_practice = 0))
) strict, without rowid;

-- Everything that ever happened to a run, in the order in which it was judged, late and repeated answers too. Only
-- appended to; a withdrawal is the one thing that removes. What counts (answer, counter) can be rebuilt from here.
create table event (
    id integer primary key,
    run_id integer not null references run (id),
    position integer not null,
    kind text not null check (kind in ('started', 'shown', 'submitted', 'ran_out', 'erased')),
    -- The key of the form that was sent. Empty for a repetition of a key, which names the first event instead.
    key text,
    repeat_of integer references event (id),
    body_hash blob,
    verdict text check (verdict in ('answered', 'late', 'timed_out', 'skipped', 'early', 'duplicate', 'retry', 'conflict')),
    at_ms integer not null,
    body text
) strict;

-- Serves three purposes: a key counts once in a run, a retry finds its first event, a withdrawal finds all events.
create unique index event_of_run on event (run_id, key);
-- Else the foreign key would search the whole table for each event that a withdrawal deletes.
create index event_repeated on event (repeat_of) where repeat_of is not null;

-- The steps that are closed, each by the event that closed it. A projection of event.
create table answer (
    event_id integer primary key references event (id),
    run_id integer not null references run (id),
    position integer not null,
    status text not null check (status in ('answered', 'late', 'timed_out', 'skipped')),
    -- Copied from the step, so that counting anew needs one table.
    problem_id integer references problem (id),
    action text,
    -- Whether it is in the counters: a choice that is neither practice nor preview, nor timed with extra time.
    is_counted integer not null check (is_counted in (0, 1)),
    shown_at_ms integer,
    answered_at_ms integer not null,
    server_ms integer,
    client_rt_ms integer,
    -- The limit as it held for this person, extra time included.
    limit_ms integer,
    deadline_ms integer,
    input text,
    hidden_ms integer,
    value text,
    -- One answer per question, the first one.
    unique (run_id, position),
    check (is_counted = 0 or problem_id is not null),
    check (status in ('answered', 'late') or action is null)
) strict;

-- How often each action was chosen, kept in the transaction of the answers. n_all counts an answer when it is given,
-- n_completed when its run is completed. The action of a question that ran out is the empty text.
create table counter (
    study_id text not null references study (id),
    is_simulated integer not null check (is_simulated in (0, 1)),
    problem_id integer not null references problem (id),
    status text not null check (status in ('answered', 'late', 'timed_out', 'skipped')),
    action text not null,
    n_all integer not null check (n_all >= 0),
    n_completed integer not null default 0 check (n_completed >= 0),
    primary key (study_id, is_simulated, problem_id, status, action),
    check (n_completed <= n_all)
) strict, without rowid;

-- Fits are derived: each can be computed again from its input, seed and program version. Old ones are history.
create table fit (
    id integer primary key,
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
    state text not null check (state in ('converged', 'unconverged', 'failed')),
    -- How many fits of this input there were, this one included: bounds the retries.
    attempts integer not null check (attempts >= 1),
    result text,
    draws blob,
    message text,
    created_at_ms integer not null,
    cpu_ms integer not null check (cpu_ms >= 0),
    check ((state = 'failed') = (result is null))
) strict;
create index fit_history on fit (study_id, is_simulated, plan, part, model, id);

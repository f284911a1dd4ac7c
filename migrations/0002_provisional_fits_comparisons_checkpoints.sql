-- What belongs beside a fit: whether it is provisional, how the models compare, and how the evidence grew.
--
-- Everything here is derived: it can be computed again from answers, study file, seed and program version. The one
-- exception is `stopping`, which keeps that, and when, a rule was seen to be reached.

-- A provisional fit started from the fit before it, so it depends on the way there. A final one follows once the study
-- has been idle for a while. All fits of schema 1 are final.
alter table fit add column is_provisional integer not null default 0 check (is_provisional in (0, 1));

-- The newest comparison of the models of each plan.
create table comparison (
    study_id text not null references study (id),
    is_simulated integer not null check (is_simulated in (0, 1)),
    plan text not null,
    -- The hash of everything that the result depends on.
    input_hash text not null,
    data_version integer not null,
    version_id integer not null references study_version (id),
    seed integer not null,
    program_version text not null,
    result text,
    -- Why there is no result.
    message text,
    created_at_ms integer not null,
    cpu_ms integer not null check (cpu_ms >= 0),
    primary key (study_id, is_simulated, plan),
    check ((result is null) <> (message is null))
) strict, without rowid;

-- What the first n people who finished say: one row per look.
create table checkpoint (
    study_id text not null references study (id),
    is_simulated integer not null check (is_simulated in (0, 1)),
    n integer not null check (n >= 1),
    -- Of the answers of these people and all else that the result depends on.
    input_hash text not null,
    program_version text not null,
    result text not null,
    created_at_ms integer not null,
    primary key (study_id, is_simulated, n)
) strict, without rowid;

-- The first time that a study's rule for stopping was reached. Written once and never changed, whatever is withdrawn or
-- computed later: it was announced. Another rule is another row.
create table stopping (
    study_id text not null references study (id),
    is_simulated integer not null check (is_simulated in (0, 1)),
    rule_hash text not null,
    -- The rule as JSON.
    rule text not null,
    n integer not null check (n >= 1),
    value real not null,
    reached_at_ms integer not null,
    primary key (study_id, is_simulated, rule_hash)
) strict, without rowid;

-- Steps of kinds that schema 1 did not know, such as replays. The list of kinds stands in the program alone from now on:
-- a list in the table would have to be copied with all of its rows for each new kind.

create table step_of_any_kind (
    run_id integer not null references run (id),
    position integer not null check (position >= 0),
    kind text not null,
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

insert into step_of_any_kind (
    run_id, position, kind, block, question, limit_ms, problem_id, is_fitted, is_practice, data
)
select run_id, position, kind, block, question, limit_ms, problem_id, is_fitted, is_practice, data
from step;

drop table step;
alter table step_of_any_kind rename to step;

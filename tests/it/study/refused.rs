//! Study files that are refused: each error names file, line, key, what was found and what is allowed.

use riskaware::study::{ParseError, Study};

use super::lab::GAMBLES;

/// Changes one place of a valid file and returns the error.
#[track_caller]
fn refused(from: &str, to: &str) -> ParseError {
    assert!(GAMBLES.contains(from), "the file does not contain {from:?}");
    let text = GAMBLES.replacen(from, to, 1);
    match Study::parse("gambles.toml", &text) {
        Ok(_) => panic!("{to:?} is accepted"),
        Err(error) => error,
    }
}

/// Checks the error after a change: its key, and parts of what was found and what is allowed. Unless the key is
/// missing, the line must be that of the change or inside it.
#[track_caller]
fn check(from: &str, to: &str, key: &str, found: &str, allowed: &str) {
    let error = refused(from, to);
    assert_eq!(error.file(), "gambles.toml");
    assert_eq!(error.key(), key, "{error}");
    assert!(error.found().contains(found), "found: {error}");
    assert!(error.allowed().contains(allowed), "allowed: {error}");
    assert!(error.line().is_some(), "no line: {error}");
}

/// The line of the first place in the changed file that holds `needle`.
#[track_caller]
fn check_line(from: &str, to: &str, needle: &str) {
    let error = refused(from, to);
    let text = GAMBLES.replacen(from, to, 1);
    let position = text.lines().position(|line| line.contains(needle)).unwrap();
    assert_eq!(error.line(), Some(position + 1), "{error}");
}

#[test]
fn an_error_reads_as_one_sentence() {
    let error = refused("limit_s = 2.5", "limit_s = 0");
    assert_eq!(
        error.to_string(),
        "gambles.toml, line 87, block[quick].limit_s: found 0; allowed: more than 0 and at most 3600 seconds; \
         leave it out for no limit"
    );
}

#[test]
fn only_flags_that_a_run_tells_by_itself_leave_people_out() {
    for name in ["short-run", "several-arrivals", "bored"] {
        check(
            "[completion]",
            &format!("[analysis]\nexclude = [\"late-answer\", \"{name}\"]\n[completion]"),
            "analysis.exclude[#2]",
            name,
            "`fast-choice`, `hidden-page`, `failed-check`, `late-answer`",
        );
    }
    check(
        "[completion]",
        "[analysis]\nexclude = [\"late-answer\", \"late-answer\"]\n[completion]",
        "analysis.exclude[#2]",
        "late-answer",
        "each flag once",
    );
}

#[test]
fn lines_are_those_of_the_key() {
    check_line("limit_s = 2.5", "limit_s = 0", "limit_s = 0");
    check_line("limit_s = 2.5", "limit = 2.5", "limit = 2.5");
    check_line("minutes = 3", "minutes = -3", "minutes = -3");
    check_line(
        "cross = { gamble = [\"wild\", \"mild\"] }",
        "cross = { gamble = [\"wild\", \"milt\"] }",
        "milt",
    );
    check_line(
        "text = \"Which one do you take?\"",
        "text = \"Which {one}?\"",
        "{one}",
    );
    check_line("max = 120", "max = 1", "max = 1");
}

#[test]
fn keys_and_kinds_of_values() {
    check("[values]", "[values", "", "invalid TOML", "TOML");
    check(
        "minutes = 3",
        "minutes = 3\nminutes = 4",
        "",
        "invalid TOML",
        "TOML",
    );
    check(
        "summary =",
        "sumary =",
        "sumary",
        "unknown key `sumary`, did you mean `summary`?",
        "`summary`",
    );
    check("minutes = 3", "", "", "no key `minutes`", "required");
    check(
        "minutes = 3",
        "minutes = \"3\"",
        "minutes",
        "string \"3\"",
        "a whole number",
    );
    check(
        "minutes = 3",
        "minutes = 0",
        "minutes",
        "0",
        "from 1 to 600",
    );
    check(
        "limit_s = 2.5",
        "limit = 2.5",
        "block[quick].limit",
        "unknown key `limit`, did you mean `limit_s`?",
        "`limit_s`",
    );
    check(
        "limit_s = 2.5",
        "limit_s = \"2.5\"",
        "block[quick].limit_s",
        "string",
        "a number",
    );
    check(
        "kind = \"form\"",
        "kind = \"froms\"",
        "block[you].kind",
        "unknown kind `froms`, did you mean `form`?",
        "`consent`",
    );
    check(
        "kind = \"form\"",
        "",
        "block[you].kind",
        "no kind",
        "`choice`",
    );
    check(
        "kind = \"form\"",
        "kind = \"info\"",
        "block[you].field",
        "unknown key `field`",
        "`scene`",
    );
    check(
        "order = \"random\"",
        "order = \"shuffled\"",
        "block[quick].order",
        "`shuffled`",
        "`random`",
    );
    check(
        "q = 0.5,",
        "q = true,",
        "factor[gamble].level[mild].values.q",
        "boolean",
        "a number or a text",
    );
    check(
        "q = 0.5,",
        "q = nan,",
        "factor[gamble].level[mild].values.q",
        "NaN",
        "a finite number",
    );
    check(
        "weighting = \"paper-range\"",
        "weighting = \"paper\"",
        "fit.weighting",
        "`paper`",
        "`paper-range`",
    );
    check(
        "ids = \"plain\"",
        "ids = \"raw\"",
        "recruiting.ids",
        "`raw`",
        "`hashed`",
    );
}

#[test]
fn a_file_of_another_format_is_not_read_further() {
    check(
        "format = 1",
        "format = 2\nnew_key = true",
        "format",
        "2",
        "1",
    );
    check(
        "format = 1",
        "format = \"1\"",
        "format",
        "string \"1\"",
        "a whole number",
    );
    check("format = 1", "", "", "no key `format`", "required");
}

#[test]
fn ids() {
    check(
        "id = \"three-gambles\"",
        "id = \"Three Gambles\"",
        "id",
        "`Three Gambles`",
        "a-z, 0-9 and -",
    );
    check("id = \"three-gambles\"", "id = \"\"", "id", "``", "1 to 40");
    let long = format!("id = \"{}\"", "a".repeat(41));
    check("id = \"three-gambles\"", &long, "id", "`aaaa", "1 to 40");
    check(
        "id = \"wild\"",
        "id = \"mild\"",
        "factor[gamble].level[mild].id",
        "for the second time",
        "each level",
    );
    check(
        "id = \"pace\"",
        "id = \"gamble\"",
        "factor[gamble].id",
        "for the second time",
        "each factor",
    );
    check(
        "id = \"middle\"",
        "id = \"safe\"",
        "action[safe].id",
        "for the second time",
        "each action",
    );
    check(
        "id = \"slow\"\ntitle",
        "id = \"quick\"\ntitle",
        "block[quick].id",
        "for the second time",
        "each block",
    );
    check(
        "id = \"you\"",
        "id = \"thanks\"",
        "block[thanks].id",
        "`thanks`",
        "the end of every run",
    );
    check(
        "id = \"both\"",
        "id = \"together\"",
        "fit.plan[together].id",
        "for the second time",
        "each plan",
    );
    check(
        "id = \"unknown-odds\"",
        "id = \"wild\"",
        "block[quick].question[wild]",
        "question `wild` for the second time",
        "each question",
    );
    check(
        "id = \"b\"",
        "id = \"a\"",
        "block[you].field[check].options[a].id",
        "for the second time",
        "each option",
    );
}

#[test]
fn placeholders_and_values() {
    check(
        "Which one do you take?",
        "Which {one}?",
        "question.text",
        "`{one}` has no value",
        "`contact`",
    );
    check(
        "{sure} points",
        "{shure} points",
        "action[safe].detail",
        "did you mean `sure`?",
        "`sure`",
    );
    check(
        "{bet}.",
        "{bet.",
        "action[bold].detail",
        "never closed",
        "`{{`",
    );
    check(
        "{bet}.",
        "bet}.",
        "action[bold].detail",
        "without a `{`",
        "`}}`",
    );
    check(
        "bet = \"",
        "bet = \"{bet} ",
        "action[bold].detail",
        "`{bet}` contains itself",
        "do not refer to themselves",
    );
    check("sure = 5", "Sure = 5", "values.Sure", "`Sure`", "a-z");
    check(
        "sure = 5",
        "limit = 5",
        "values.limit",
        "`limit`",
        "fixed meaning",
    );
    check(
        "About {minutes}",
        "About {limit}",
        "block[consent].text",
        "`{limit}` has no value",
        "`minutes`",
    );
}

#[test]
fn outcomes() {
    check(
        "p = \"q\"",
        "p = \"qq\"",
        "action[bold].outcomes[#1].p",
        "unknown name `qq`",
        "`q`",
    );
    check(
        "p = \"q\"",
        "p = \"bet\"",
        "action[bold].outcomes[#1].p",
        "which is a text",
        "a number",
    );
    check(
        "q = 0.1",
        "q = 1.1",
        "action[bold].outcomes[#1].p",
        "1.1 (in question quick/wild)",
        "from 0 to 1",
    );
    check(
        "p = 0.5, reward = \"mid\"",
        "p = 0.8, reward = \"mid\"",
        "action[middle].outcomes[#3].p",
        "sum to 1.05",
        "at most 1",
    );
    check(
        "p = 0.25",
        "p = \"rest\"",
        "action[middle].outcomes[#3].p",
        "`rest` for the second time",
        "one `rest`",
    );
    check(
        "{ p = 1, reward",
        "{ p = 0.9, reward",
        "action[safe].outcomes",
        "sum to 0.9",
        "sum to 1",
    );
    check(
        "[{ p = 1, reward = \"sure\" }]",
        "[]",
        "action[safe].outcomes",
        "at least one outcome",
        "sum to 1",
    );
    check(
        "reward = \"-loss\"",
        "reward = \"--loss\"",
        "action[bold].outcomes[#2].reward",
        "unknown name `-loss`",
        "`loss`",
    );
    check(
        "fitted = false",
        "",
        "block[quick].question[unknown-odds]",
        "without all of its probabilities",
        "`fitted = false`",
    );
}

#[test]
fn levels_and_cells() {
    check(
        "levels = { pace = \"quick\" }",
        "levels = { pace = \"slow\" }",
        "block[slow].group[#1]",
        "cell `mild/slow` for the second time, with another time limit",
        "a factor for what differs",
    );
    check(
        "levels = { pace = \"quick\" }",
        "levels = { pase = \"quick\" }",
        "block[quick].levels.pase",
        "did you mean `pace`?",
        "`gamble`",
    );
    check(
        "levels = { pace = \"quick\" }",
        "levels = { pace = \"quik\" }",
        "block[quick].levels.pace",
        "did you mean `quick`?",
        "`slow`",
    );
    check(
        "levels = { pace = \"quick\" }",
        "",
        "block[quick].group[#1].levels",
        "without a level of: pace",
        "every factor",
    );
    check(
        "levels = { gamble = \"hidden\" }",
        "levels = { pace = \"slow\" }",
        "block[quick].question[unknown-odds].levels",
        "already set to `quick`",
        "not set further out",
    );
    check(
        "[\"wild\", \"mild\"]",
        "[\"wild\", \"wild\"]",
        "block[quick].group[#1].cross.gamble[#2]",
        "for the second time",
        "each level once",
    );
    check(
        "[\"wild\", \"mild\"]",
        "[]",
        "block[quick].group[#1].cross.gamble",
        "an empty list",
        "a list of levels",
    );
    check(
        "fitted = false",
        "fitted = false\nactions = []",
        "block[quick].question[unknown-odds].actions",
        "0 actions",
        "two actions",
    );
    check(
        "by = [\"pace\", \"gamble\"]",
        "by = [\"pace\", \"risk\"]",
        "fit.plan[both].by[#2]",
        "unknown factor `risk`",
        "`gamble`, `pace`",
    );
    check(
        "by = [\"pace\", \"gamble\"]",
        "by = [\"pace\", \"pace\"]",
        "fit.plan[both].by[#2]",
        "for the second time",
        "each factor once",
    );
}

#[test]
fn the_same_cell_cannot_hold_two_problems() {
    check(
        "levels = { gamble = \"hidden\" }\nfitted = false",
        "levels = { gamble = \"mild\" }\nvalues = { gain = 21 }",
        "block[quick].question[unknown-odds]",
        "cell `mild/quick` for the second time, with another choice problem",
        "a factor for what differs",
    );
}

#[test]
fn blocks() {
    check(
        "[block.start]\ntitle = \"Ready?\"\ntext = \"You have {limit} seconds each.\"\nbutton = \"Go\"",
        "",
        "block[quick].start",
        "no start page",
        "starts the clock",
    );
    check(
        "limit_s = 2.5",
        "limit_s = 3600.1",
        "block[quick].limit_s",
        "3600.1",
        "at most 3600",
    );
    check(
        "limit_s = 2.5",
        "limit_s = nan",
        "block[quick].limit_s",
        "NaN",
        "more than 0",
    );
    check(
        "limit_s = 2.5",
        "limit_s = 2.5\npractice = true\nbaseline = true",
        "block[quick].baseline",
        "practice",
        "either",
    );
    check(
        "limit_s = 2.5",
        "limit_s = 2.5\nreference_share = 0.9",
        "block[quick].reference_share",
        "no baseline",
        "`baseline = true`",
    );
    check(
        "limit_s = 2.5",
        "limit_s = 2.5\npractice = true\nfitted = true",
        "block[quick].fitted",
        "`true`",
        "never fitted",
    );
    check(
        "limit_s = 2.5",
        "limit_s = 2.5\nscene = \"A/B\"",
        "block[quick].scene",
        "`A/B`",
        "a-z",
    );
    check(
        "title = \"Choose\"",
        "title = \" \"",
        "block[slow].title",
        "an empty text",
        "a line of text",
    );
    check(
        "cross = { gamble = [\"mild\", \"wild\"] }\norder = \"random\"",
        "",
        "block[slow].group[#1]",
        "without levels",
        "`cross`",
    );
}

#[test]
fn forms() {
    check(
        "max = 120",
        "max = 1",
        "block[you].field[age].max",
        "1",
        "18 or more",
    );
    check(
        "min = 18\n",
        "",
        "block[you].field[age].min",
        "no value",
        "a whole number",
    );
    check(
        "min = 18",
        "min = 18\nmax_length = 3",
        "block[you].field[age].max_length",
        "kind `integer`",
        "`text`, `long_text` only",
    );
    check(
        "max_length = 10",
        "max_length = 0",
        "block[you].field[remark].max_length",
        "0",
        "1 to 5000",
    );
    check(
        "id = \"remark\"",
        "id = \"action\"",
        "block[you].field[action].id",
        "`action`",
        "uses this one for itself",
    );
    check(
        "id = \"remark\"",
        "id = \"colour-other\"",
        "block[you].field[colour-other].id",
        "`colour-other`",
        "uses this one for itself",
    );
    check(
        "id = \"red\"",
        "id = \"other\"",
        "block[you].field[colour].options[other].id",
        "`other`",
        "adds this option by itself",
    );
    check(
        "expected = \"b\"",
        "expected = \"c\"",
        "block[you].field[check].expected",
        "`c`",
        "`a`, `b`",
    );
    check(
        "other = true\n",
        "",
        "block[you].field[colour].options",
        "1 options",
        "two options",
    );
    check(
        "kind = \"text\"",
        "kind = \"text\"\nautocomplete = \"a b\"",
        "block[you].field[remark].autocomplete",
        "`a b`",
        "autocomplete",
    );
}

#[test]
fn a_form_that_could_be_too_long_to_be_sent() {
    let field = |number: usize| {
        format!(
            "id = \"remark-{number}\"\nkind = \"long_text\"\nlabel = \"Anything?\"\nmax_length = 5000\n"
        )
    };
    let fields: Vec<String> = (0..10).map(field).collect();
    let remark = "id = \"remark\"\nkind = \"text\"\nlabel = \"Anything else?\"\nmax_length = 10\n";
    // The own words of the field before it are the 200 that are too many.
    check(
        remark,
        &fields.join("\n[[block.field]]\n"),
        "block[you].field",
        "up to 50200 characters",
        "up to 50000",
    );
}

#[test]
fn completion_and_fit() {
    check(
        "code = \"GAMBLE-1\"",
        "code = \"A B\"",
        "completion.code",
        "`A B`",
        "letters",
    );
    for address in [
        "http://panel.example/{code}",
        "https://{code}.example/",
        "https://",
        "javascript:x",
        "https://u@a.example/",
    ] {
        let to = format!("redirect = \"{address}\"");
        check(
            "redirect = \"https://panel.example/done?cc={code}\"",
            &to,
            "completion.redirect",
            address,
            "https://",
        );
    }
    check(
        "redirect = \"https://panel.example/done?cc={code}\"",
        "redirect = \"https://panel.example/done?cc={name}\"",
        "completion.redirect",
        "`{name}`",
        "`{code}`",
    );
    check(
        "samples = 50",
        "samples = 1",
        "fit.samples",
        "1",
        "from 2 to 1000",
    );
    check(
        "[0.4, 1]",
        "[1, 0.4]",
        "fit.priors.gamma.uniform",
        "[1, 0.4]",
        "the smaller first",
    );
    check(
        "[0.4, 1]",
        "[0.4, 1.1]",
        "fit.priors.gamma.uniform",
        "[0.4, 1.1]",
        "from 0 to 1",
    );
    check(
        "median = 3",
        "median = 0",
        "fit.priors.tau.log_normal.median",
        "0",
        "above 0",
    );
    check(
        "tau =",
        "theta =",
        "fit.priors.theta",
        "unknown key `theta`",
        "`tau`",
    );
    check(
        "gamma = { uniform = [0.4, 1] }",
        "gamma = { log_normal = { median = 1, log_sd = 1 } }",
        "fit.priors.gamma",
        "`log_normal`",
        "uniform",
    );
    check(
        "contact =",
        "reference_reward = 0\ncontact =",
        "reference_reward",
        "0",
        "other than 0",
    );
    check(
        "[recruiting]",
        "[[paper]]\nlabel = \"x\"\nlevels = { pace = \"fast\" }\n[recruiting]",
        "paper[#1].levels.pace",
        "`fast` is no level of pace",
        "`quick`",
    );
}

#[test]
fn a_product_of_too_many_levels() {
    let mut factors = String::new();
    let mut cross = Vec::new();
    for factor in 0..40 {
        factors += &format!("[[factor]]\nid = \"f{factor}\"\nlabel = \"F\"\n");
        factors += "level = [{ id = \"a\", label = \"A\" }, { id = \"b\", label = \"B\" }]\n";
        cross.push(format!("f{factor} = [\"a\", \"b\"]"));
    }
    let text = GAMBLES
        .replacen("[[action]]", &format!("{factors}[[action]]"), 1)
        .replacen("gamble = [\"wild\", \"mild\"]", &cross.join(", "), 1);
    let error = Study::parse("gambles.toml", &text).unwrap_err();
    assert_eq!(error.key(), "block[quick].group[#1].cross");
    assert_eq!(
        error.allowed(),
        "at most 1000 combinations of levels in a group"
    );
}

#[test]
fn arbitrary_damage_never_panics() {
    // Each line left out, doubled or cut short: a valid study or an error, whatever the damage.
    let lines: Vec<&str> = GAMBLES.lines().collect();
    for index in 0..lines.len() {
        let mut without = lines.clone();
        without.remove(index);
        let mut doubled = lines.clone();
        doubled.insert(index, lines[index]);
        let mut cut = lines.clone();
        cut[index] = &cut[index][..cut[index].len() / 2];
        for text in [without, doubled, cut] {
            if let Err(error) = Study::parse("damaged.toml", &text.join("\n")) {
                assert!(
                    !error.found().is_empty() && !error.allowed().is_empty(),
                    "line {index}: {error}"
                );
            }
        }
    }
}

#[test]
fn a_factor_with_the_name_of_another_column_of_the_data_is_refused() {
    for name in ["status", "source", "condition", "count"] {
        let named = "id = \"gamble\"\nlabel";
        check(
            named,
            &named.replace("gamble", name),
            &format!("factor[{name}].id"),
            &format!("`{name}`, which is the name of another column"),
            "another id than study, version",
        );
    }
}

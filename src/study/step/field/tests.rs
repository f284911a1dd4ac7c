use proptest::prelude::*;

use super::*;

fn field(kind: FieldKind, required: bool) -> Field {
    Field {
        id: "f".to_owned(),
        label: "Label".to_owned(),
        hint: None,
        required,
        kind,
        correct: None,
        expected: None,
        autocomplete: None,
    }
}

fn options(ids: &[&str]) -> Vec<FieldOption> {
    let option = |id: &&str| FieldOption {
        id: (*id).to_owned(),
        label: id.to_uppercase(),
        screens_out: *id == "none",
    };
    ids.iter().map(option).collect()
}

fn scale(required: bool) -> Field {
    let item = |id: &str, reverse, expected| LikertItem {
        id: id.to_owned(),
        text: format!("text of {id}"),
        reverse,
        expected,
    };
    let kind = FieldKind::Likert {
        points: ["no", "", "", "", "yes"].map(str::to_owned).to_vec(),
        items: vec![
            item("dares", false, None),
            item("fears", true, None),
            item("reads", false, Some(4)),
        ],
    };
    field(kind, required)
}

fn read(field: &Field, posted: &[(&str, &str)]) -> Result<Map<String, Value>, Vec<FieldError>> {
    let posted: Fields = posted
        .iter()
        .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()))
        .collect();
    let mut values = Map::new();
    field
        .read(&posted, &crate::study::Words::english(), &mut values)
        .map(|()| values)
}

#[test]
fn a_number_is_read_in_plain_notation_only() {
    let kind = FieldKind::Number {
        min: -2.5,
        max: 100.0,
        digits: 2,
    };
    let field = field(kind, true);
    for (typed, number) in [
        ("3", 3.0),
        ("3.25", 3.25),
        ("3,25", 3.25),
        ("-2.5", -2.5),
        ("\u{2212}1", -1.0),
        (".5", 0.5),
        ("7.", 7.0),
        ("-0", 0.0),
    ] {
        let values = read(&field, &[("f", typed)]).unwrap();
        assert_eq!(values["f"].as_f64(), Some(number), "{typed}");
    }
    for typed in [
        "", "x", "1e1", "3.255", "-2.51", "100.01", "NaN", "inf", "1 000", ".", "--1",
    ] {
        assert!(read(&field, &[("f", typed)]).is_err(), "{typed}");
    }
}

proptest! {
    #[test]
    fn every_number_with_few_digits_is_read_as_typed(hundredths in -99_999_i64..99_999) {
        let kind = FieldKind::Number { min: -1_000.0, max: 1_000.0, digits: 2 };
        let number = hundredths as f64 / 100.0;
        let values = read(&field(kind, true), &[("f", &format!("{number:.2}"))]).unwrap();
        prop_assert_eq!(values["f"].as_f64(), Some(number));
    }
}

#[test]
fn several_options_are_stored_in_file_order_and_counted() {
    let kind = FieldKind::Choices {
        options: options(&["car", "bus", "bike", "none"]),
        min: 1,
        max: 2,
    };
    let field = field(kind, false);
    let values = read(&field, &[("f", "bike"), ("f", "car"), ("f", "bike")]).unwrap();
    assert_eq!(values["f"], serde_json::json!(["car", "bike"]));
    assert_eq!(read(&field, &[]), Ok(Map::new()));
    assert!(read(&field, &[("f", "car"), ("f", "bus"), ("f", "bike")]).is_err());
    assert!(read(&field, &[("f", "car"), ("f", "train")]).is_err());
    assert!(field.screens_out(&read(&field, &[("f", "none")]).unwrap()));
    assert!(!field.screens_out(&values));
}

#[test]
fn a_scale_stores_points_and_turns_scores() {
    let scale = scale(false);
    let values = read(&scale, &[("dares", "2"), ("fears", "2"), ("reads", "4")]).unwrap();
    assert_eq!(values["fears"], Value::from(2));
    assert_eq!(scale.score("dares", &values), Some(2));
    assert_eq!(scale.score("fears", &values), Some(4));
    assert_eq!(scale.score("unknown", &values), None);
    assert_eq!(scale.passes(&values), Some(true));
    let other = read(&scale, &[("reads", "1")]).unwrap();
    assert_eq!(scale.passes(&other), Some(false));
    assert_eq!(scale.score("dares", &other), None);
    assert_eq!(scale.passes(&Map::new()), None);
    assert_eq!(scale.value_names(), ["dares", "fears", "reads"]);
}

#[test]
fn each_unanswered_line_of_a_required_scale_is_named() {
    let errors = read(&scale(true), &[("dares", "6"), ("fears", "1")]).unwrap_err();
    let named: Vec<&str> = errors.iter().map(|error| error.field.as_str()).collect();
    assert_eq!(named, ["dares", "reads"]);
}

#[test]
fn any_closed_kind_can_ask_for_one_certain_answer() {
    let mut several = field(
        FieldKind::Choices {
            options: options(&["a", "b", "c"]),
            min: 0,
            max: 3,
        },
        false,
    );
    several.expected = Some(serde_json::json!(["a", "c"]));
    let passes = |posted: &[(&str, &str)]| several.passes(&read(&several, posted).unwrap());
    assert_eq!(passes(&[("f", "c"), ("f", "a")]), Some(true));
    assert_eq!(passes(&[("f", "a")]), Some(false));

    let mut number = field(FieldKind::Integer { min: 0, max: 9 }, false);
    number.expected = Some(Value::from(7));
    assert_eq!(
        number.passes(&read(&number, &[("f", "7")]).unwrap()),
        Some(true)
    );
    assert_eq!(
        number.passes(&read(&number, &[("f", "8")]).unwrap()),
        Some(false)
    );
}

#[test]
fn the_end_of_a_line_counts_once_as_on_the_page() {
    let text = field(FieldKind::LongText { max_length: 3 }, true);
    let values = read(&text, &[("f", "a\r\nb")]).unwrap();
    assert_eq!(values["f"], "a\nb");
    assert!(read(&text, &[("f", "a\r\nbc")]).is_err());
}

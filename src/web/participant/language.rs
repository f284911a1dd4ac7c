//! In which language a person meets a study.

use axum::http::{HeaderMap, header};

/// The language that a person gets: that of the link if the study has it, else the one that their browser likes best
/// among those of the study, else the study's first. None where the study has one alone, since nothing is chosen then.
pub(in crate::web) fn choose(
    languages: &[String],
    link: Option<&str>,
    headers: &HeaderMap,
) -> Option<String> {
    if languages.len() < 2 {
        return None;
    }
    let liked = liked(headers);
    link.and_then(|link| matching(languages, link))
        .or_else(|| liked.iter().find_map(|liked| matching(languages, liked)))
        .or(languages.first())
        .cloned()
}

/// The languages of `Accept-Language`, the most wanted first; those of the same quality in the header's order.
pub(in crate::web) fn liked(headers: &HeaderMap) -> Vec<String> {
    let values = headers.get_all(header::ACCEPT_LANGUAGE).iter();
    let mut ranges: Vec<(f32, String)> = values
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .filter_map(|range| {
            let mut parts = range.split(';');
            let tag = parts.next()?.trim();
            let quality = match parts.next() {
                None => 1.0,
                Some(quality) => quality.trim().strip_prefix("q=")?.trim().parse().ok()?,
            };
            // Whoever takes anything gets the study's first language, as does whoever says nothing.
            let is_named = !tag.is_empty() && tag != "*" && quality > 0.0;
            is_named.then(|| (quality, tag.to_owned()))
        })
        .collect();
    ranges.sort_by(|left, right| right.0.total_cmp(&left.0));
    ranges.into_iter().map(|(_, tag)| tag).collect()
}

/// The study's language for a tag: the same one, else the one for its language without region (`de` for `de-AT`), else
/// one of another region (`pt-BR` for `pt` or `pt-PT`).
fn matching<'a>(languages: &'a [String], tag: &str) -> Option<&'a String> {
    let find =
        |is_match: &dyn Fn(&str) -> bool| languages.iter().find(|language| is_match(language));
    find(&|language| language.eq_ignore_ascii_case(tag))
        .or_else(|| find(&|language| language.eq_ignore_ascii_case(primary(tag))))
        .or_else(|| find(&|language| primary(language).eq_ignore_ascii_case(primary(tag))))
}

fn primary(tag: &str) -> &str {
    tag.split('-').next().unwrap_or(tag)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(accept: &str) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT_LANGUAGE, accept.parse().unwrap());
        headers
    }

    #[track_caller]
    fn check(languages: &[&str], link: Option<&str>, accept: &str, expected: Option<&str>) {
        let languages: Vec<String> = languages.iter().map(ToString::to_string).collect();
        let chosen = choose(&languages, link, &headers(accept));
        assert_eq!(chosen.as_deref(), expected, "{link:?}, {accept}");
    }

    #[test]
    fn the_browser_is_asked_by_quality() {
        let both = ["en", "de"];
        check(&both, None, "de", Some("de"));
        check(&both, None, "fr, en;q=0.3, de;q=0.8", Some("de"));
        check(&both, None, "de;q=0.5, en", Some("en"));
        check(&both, None, "de-CH, en;q=0.9", Some("de"));
        check(&both, None, "de;q=0, en;q=0.1", Some("en"));
        check(&both, None, "fr, *;q=0.5", Some("en"));
        check(&both, None, "de;q=much", Some("en"));
        check(&both, None, "", Some("en"));
        check(&["de", "en"], None, "", Some("de"));
    }

    #[test]
    fn the_link_comes_before_the_browser_where_the_study_has_its_language() {
        check(&["en", "de"], Some("de"), "en", Some("de"));
        check(&["en", "de"], Some("DE-at"), "en", Some("de"));
        check(&["en", "de"], Some("fr"), "de", Some("de"));
        check(&["en", "pt-BR"], Some("pt"), "en", Some("pt-BR"));
    }

    #[test]
    fn a_study_in_one_language_leaves_no_choice() {
        check(&["en"], Some("de"), "de", None);
    }
}

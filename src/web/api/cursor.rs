//! Lists that page: a cursor says where a page ended, and links (RFC 8288) lead to the next page and the first.
//!
//! A cursor names the last row, not a number of rows, so that rows which come meanwhile neither repeat nor hide another.
//! Clients pass it back as it is: what stands in it may change.

use axum::{
    http::{HeaderMap, HeaderValue, header},
    response::{IntoResponse, Response},
};
use data_encoding::BASE64URL_NOPAD;

use crate::web::Error;

/// The cursor of a row with this key.
pub(super) fn cursor(key: &[i64]) -> String {
    let key: Vec<String> = key.iter().map(i64::to_string).collect();
    BASE64URL_NOPAD.encode(key.join(".").as_bytes())
}

/// The key in a cursor.
pub(super) fn key<const N: usize>(cursor: &str) -> Result<[i64; N], Error> {
    let read = || {
        let text = String::from_utf8(BASE64URL_NOPAD.decode(cursor.as_bytes()).ok()?).ok()?;
        let numbers: Option<Vec<i64>> = text.split('.').map(|part| part.parse().ok()).collect();
        numbers?.try_into().ok()
    };
    read().ok_or_else(|| {
        Error::BadRequest(format!(
            "after is `{cursor}`; allowed: the `next` of an earlier page"
        ))
    })
}

/// How many rows a page has.
pub(super) fn rows(limit: Option<u32>, default: u32, most: u32) -> Result<u32, Error> {
    let limit = limit.unwrap_or(default);
    if (1..=most).contains(&limit) {
        Ok(limit)
    } else {
        Err(Error::BadRequest(format!(
            "limit is {limit}; allowed: 1 to {most}"
        )))
    }
}

/// A page with its links.
///
/// `first` is the address of the first page, with its query.
pub(super) fn linked(page: impl IntoResponse, first: &str, next: Option<&str>) -> Response {
    let mut links = vec![format!("<{first}>; rel=\"first\"")];
    links.extend(next.map(|next| format!("<{first}&after={next}>; rel=\"next\"")));
    let mut headers = HeaderMap::new();
    // Ids of studies are letters, digits and hyphens, and so are cursors.
    if let Ok(links) = HeaderValue::from_str(&links.join(", ")) {
        headers.insert(header::LINK, links);
    }
    (headers, page).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cursors_read_back_and_others_are_refused() {
        assert_eq!(key::<2>(&cursor(&[12, 3])).unwrap(), [12, 3]);
        let too_long = cursor(&[1, 2, 3]);
        for text in ["", "12", "a-b", "MTI", "!", &too_long] {
            assert!(key::<2>(text).is_err(), "{text}");
        }
    }
}

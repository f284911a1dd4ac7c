//! Style sheets, scripts and drawings, compiled in and served under a path that changes with their content.

use std::sync::LazyLock;

use axum::{
    Router,
    extract::Path,
    http::{HeaderValue, header},
    response::{IntoResponse, Response},
    routing::get,
};
use include_dir::{Dir, include_dir};
use sha2::{Digest, Sha256};

use super::{AppState, Error};

static FILES: Dir = include_dir!("$CARGO_MANIFEST_DIR/static");

/// First 16 hex digits of the SHA-256 over all names and contents: one version for the whole folder, so that relative imports between modules stay in step.
static VERSION: LazyLock<String> = LazyLock::new(|| {
    let mut hash = Sha256::new();
    add(&FILES, &mut hash);
    data_encoding::HEXLOWER.encode(&hash.finalize()[..8])
});

fn add(dir: &Dir, hash: &mut Sha256) {
    for file in dir.files() {
        hash.update(file.path().as_os_str().as_encoded_bytes());
        hash.update(file.contents());
    }
    for dir in dir.dirs() {
        add(dir, hash);
    }
}

/// The address of a file in `static/`, for templates.
pub fn url(path: &str) -> String {
    format!("/static/{}/{path}", *VERSION)
}

/// The text of a compiled-in file, for drawings that stand inside a page.
pub fn text(path: &str) -> Option<&'static str> {
    FILES.get_file(path)?.contents_utf8()
}

pub(super) fn router() -> Router<AppState> {
    Router::new().route("/static/{version}/{*path}", get(asset))
}

async fn asset(Path((version, path)): Path<(String, String)>) -> Result<Response, Error> {
    let file = FILES.get_file(&path).ok_or(Error::NotFound("file"))?;
    // A page from before an upgrade still gets its files, but nobody keeps them under the old name.
    let cache = if version == *VERSION {
        "public, max-age=31536000, immutable"
    } else {
        "no-store"
    };
    let headers = [
        (
            header::CONTENT_TYPE,
            HeaderValue::from_static(content_type(&path)),
        ),
        (header::CACHE_CONTROL, HeaderValue::from_static(cache)),
    ];
    Ok((headers, file.contents()).into_response())
}

fn content_type(path: &str) -> &'static str {
    match path.rsplit_once('.').map(|(_, extension)| extension) {
        Some("css") => "text/css; charset=utf-8",
        Some("js" | "mjs") => "text/javascript; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("png") => "image/png",
        Some("json") => "application/json",
        _ => "text/plain; charset=utf-8",
    }
}

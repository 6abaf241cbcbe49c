//! What is built into the binary: the page.

use axum::{
    body::Body,
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};
use rust_embed::{EmbeddedFile, RustEmbed};

/// The page as built by `npm run build`.
#[derive(RustEmbed)]
#[folder = "web/dist/"]
struct Page;

/// A file of the page. The empty path is its first page, and a name without an ending is the page of that name.
pub(crate) fn page(path: &str) -> Response {
    let html = match path {
        "" => "index.html".to_owned(),
        // The same page: what it may do is settled on its connection.
        "spectator" => "experimenter.html".to_owned(),
        name => format!("{name}.html"),
    };
    match Page::get(path) {
        None if !path.contains('.') => respond(Page::get(&html), &html),
        file => respond(file, path),
    }
}

/// Changes whenever a script changes: a browser that still runs an older one reloads itself.
pub(crate) fn page_version() -> String {
    let mut version = [0_u8; 8];
    for script in Page::iter().filter(|name| name.ends_with(".js")) {
        let hash = Page::get(&script).map(|file| file.metadata.sha256_hash()).unwrap_or_default();
        version.iter_mut().zip(hash).for_each(|(byte, other)| *byte ^= other);
    }
    version.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn respond(file: Option<EmbeddedFile>, path: &str) -> Response {
    let Some(file) = file else {
        return (StatusCode::NOT_FOUND, format!("there is no {path} here\n")).into_response();
    };
    // The same address serves another file after an update, so the browser must ask again each time.
    let headers = [
        (header::CONTENT_TYPE, content_type(path)),
        (header::CACHE_CONTROL, "no-cache"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    (headers, Body::from(file.data.into_owned())).into_response()
}

fn content_type(path: &str) -> &'static str {
    match path.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("json" | "map") => "application/json",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_page_is_html_and_names_its_script() {
        let response = page("");
        assert_eq!(response.status(), StatusCode::OK);
        assert_eq!(response.headers()[header::CONTENT_TYPE], "text/html; charset=utf-8");
        let html = Page::get("index.html").unwrap().data;
        assert!(String::from_utf8_lossy(&html).contains("app.js"));
    }

    #[test]
    fn each_page_has_an_address_without_an_ending() {
        for name in ["experimenter", "spectator", "replay"] {
            let response = page(name);
            assert_eq!(response.status(), StatusCode::OK, "{name}");
            assert_eq!(response.headers()[header::CONTENT_TYPE], "text/html; charset=utf-8");
        }
        assert_eq!(page("nothing").status(), StatusCode::NOT_FOUND);
    }

    #[test]
    fn an_unknown_file_and_a_way_out_of_the_folder_are_not_found() {
        for path in ["nothing.js", "../Cargo.toml", "/etc/passwd", "a/../../build.rs"] {
            assert_eq!(page(path).status(), StatusCode::NOT_FOUND, "{path}");
        }
    }
}

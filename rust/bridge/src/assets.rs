//! What is built into the binary: the page.

use crate::encoding::encoded_response;
use axum::{
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};
use rust_embed::{EmbeddedFile, RustEmbed};

/// The page as built by `npm run build`.
#[derive(RustEmbed)]
#[folder = "web/dist/"]
struct PageAssets;

/// A file of the page, compressed if `gzip`. The empty path is its first page, and a name without an ending is the page of
/// that name.
pub(crate) fn asset_response(path: &str, gzip: bool) -> Response {
    let html = match path {
        "" => "index.html".to_owned(),
        // The same page: what it may do is settled on its connection.
        "spectator" => "experimenter.html".to_owned(),
        name => format!("{name}.html"),
    };
    match PageAssets::get(path) {
        None if !path.contains('.') => respond(PageAssets::get(&html), &html, gzip),
        file => respond(file, path, gzip),
    }
}

/// The figures of reports: a script that runs without a browser and makes a function `figure`, JSON in and SVG out.
pub const FIGURES_SCRIPT: &str = include_str!("../web/dist-figures/figures.js");

/// Changes whenever a script changes: a browser that still runs an older one reloads itself.
pub(crate) fn page_version() -> String {
    // Names hold hashes, but two versions may share a script.
    let mut version = [0_u8; 8];
    for script in PageAssets::iter().filter(|name| name.ends_with(".js")) {
        let hash = PageAssets::get(&script).map(|file| file.metadata.sha256_hash()).unwrap_or_default();
        version.iter_mut().zip(hash).for_each(|(byte, other)| *byte ^= other);
    }
    version.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn respond(file: Option<EmbeddedFile>, path: &str, gzip: bool) -> Response {
    let Some(file) = file else {
        return (StatusCode::NOT_FOUND, format!("there is no {path} here\n")).into_response();
    };
    let headers = [
        (header::CONTENT_TYPE, content_type(path)),
        (
            header::CACHE_CONTROL,
            if has_content_hash(path) { "max-age=31536000, immutable" } else { "no-cache" },
        ),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    match PageAssets::get(&format!("{path}.gz")).filter(|_| gzip) {
        Some(small) => encoded_response(headers, small.data.into_owned(), true),
        None => encoded_response(headers, file.data.into_owned(), false),
    }
}

/// Whether the name holds the hash of the content, as the bundler gives it: `app-5QGFAMWX.js`. What has no such name may be
/// another file after an update, so that the browser asks again each time.
fn has_content_hash(path: &str) -> bool {
    let name = path.split('.').next().unwrap_or(path);
    name.rsplit_once('-').is_some_and(|(_, hash)| {
        hash.len() == 8 && hash.bytes().all(|byte| byte.is_ascii_uppercase() || byte.is_ascii_digit())
    })
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

    /// The scripts and styles that the first page names.
    fn linked_assets() -> Vec<String> {
        let html = PageAssets::get("index.html").unwrap().data;
        let html = String::from_utf8_lossy(&html).into_owned();
        let names = html.split('"').filter(|part| part.starts_with("/app-"));
        names.map(|name| name.trim_start_matches('/').to_owned()).collect()
    }

    #[test]
    fn the_first_page_is_html_is_asked_for_again_and_names_files_that_are_kept() {
        let response = asset_response("", false);
        assert_eq!(response.status(), StatusCode::OK);
        assert_eq!(response.headers()[header::CONTENT_TYPE], "text/html; charset=utf-8");
        assert_eq!(response.headers()[header::CACHE_CONTROL], "no-cache");
        let names = linked_assets();
        assert_eq!(names.len(), 2, "{names:?}");
        for name in names {
            let response = asset_response(&name, true);
            assert_eq!(response.status(), StatusCode::OK, "{name}");
            assert_eq!(response.headers()[header::CONTENT_ENCODING], "gzip", "{name}");
            assert!(
                response.headers()[header::CACHE_CONTROL].to_str().unwrap().contains("immutable"),
                "{name}"
            );
            assert!(!asset_response(&name, false).headers().contains_key(header::CONTENT_ENCODING), "{name}");
        }
    }

    #[test]
    fn all_scripts_and_styles_are_small_on_the_line() {
        let small = |name: &str| {
            PageAssets::get(&format!("{name}.gz")).or_else(|| PageAssets::get(name)).unwrap().data.len()
        };
        let loaded = PageAssets::iter().filter(|name| name.ends_with(".js") || name.ends_with(".css"));
        let bytes: usize = loaded.map(|name| small(&name)).sum();
        // All pages together, and what a page loads only when it is opened (signals, scores); with arm and meshes the first load is measured in a browser, tests/page/download_size.mjs.
        assert!(bytes < 320_000, "{bytes} bytes");
    }

    #[test]
    fn only_names_with_a_hash_are_kept() {
        assert!(has_content_hash("app-5QGFAMWX.js") && has_content_hash("shared-OPDDIRSV.js.LEGAL.txt"));
        assert!(
            !has_content_hash("index.html")
                && !has_content_hash("reference-board.html")
                && !has_content_hash("icon.svg")
        );
    }

    #[test]
    fn each_page_has_an_address_without_an_ending() {
        for name in ["experimenter", "spectator", "replay"] {
            let response = asset_response(name, false);
            assert_eq!(response.status(), StatusCode::OK, "{name}");
            assert_eq!(response.headers()[header::CONTENT_TYPE], "text/html; charset=utf-8");
        }
        assert_eq!(asset_response("nothing", true).status(), StatusCode::NOT_FOUND);
    }

    #[test]
    fn an_unknown_file_and_a_way_out_of_the_folder_are_not_found() {
        for path in ["nothing.js", "../Cargo.toml", "/etc/passwd", "a/../../build.rs"] {
            assert_eq!(asset_response(path, true).status(), StatusCode::NOT_FOUND, "{path}");
        }
    }
}

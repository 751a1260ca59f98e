//! The page on which people see a network: its parts, and the same page as one file.
//!
//! | module | job |
//! |---|---|
//! | `connections` | Limits of the server's connections |
//! | `editor` | A site's file as the user changes it |
//! | `log` | The events so far, for pages that are opened late |
//! | `picture` | A run as a small picture that moves |
//! | `server` | Serves page and events, and takes commands |
//!
//! The page is plain HTML, CSS and JavaScript in `page/`, embedded in the program. It asks only this
//! server for data.

use results::record::event::Event;

mod connections;
mod editor;
mod log;
mod picture;
mod server;

pub use editor::{
    Asked, Begun, EditError, Editing, Editor, Hindrance, Judged, Layout, Placed, Saved, Side,
    SiteFile,
};
pub use log::Log;
pub use picture::animation;
pub use server::{About, Command, Server, ServerError, serve, serve_editor};

/// The page's frame.
const INDEX: &str = include_str!("page/index.html");
/// Its style.
const STYLE: &str = include_str!("page/style.css");
/// Its scripts, in the order in which they are loaded.
const SCRIPTS: [&str; 9] = [
    include_str!("page/state.js"),
    include_str!("page/geometry.js"),
    include_str!("page/brush.js"),
    include_str!("page/layer.js"),
    include_str!("page/map.js"),
    include_str!("page/panels.js"),
    include_str!("page/timeline.js"),
    include_str!("page/source.js"),
    include_str!("page/main.js"),
];

/// The frame of the page on which a site is edited.
const EDITOR: &str = include_str!("page/editor.html");
/// Scripts of that page.
const EDITOR_SCRIPTS: [&str; 4] = [
    include_str!("page/geometry.js"),
    include_str!("page/editor-plan.js"),
    include_str!("page/editor-words.js"),
    include_str!("page/editor.js"),
];

/// Mark in `index.html` that is replaced by the page's style and scripts.
const LINKED: &str = "<!-- style and script -->";

/// All scripts in one.
fn script() -> String {
    strict(&SCRIPTS.concat())
}

/// All scripts of the page on which a site is edited, in one.
fn editor_script() -> String {
    strict(&EDITOR_SCRIPTS.concat())
}

fn strict(script: &str) -> String {
    // In a block, so that its names are its own.
    format!("'use strict';\n{{\n{script}}}\n")
}

/// The page as the server sends it.
fn page() -> String {
    linked(INDEX)
}

/// The page on which a site is edited.
fn editor_page() -> String {
    linked(EDITOR)
}

fn linked(page: &str) -> String {
    let linked =
        "<link rel=\"stylesheet\" href=\"style.css\">\n<script src=\"app.js\" defer></script>";
    page.replace(LINKED, linked)
}

/// The page with these events in one file, which opens without a server. It runs no script but its own,
/// and asks no server for anything.
///
/// # Errors
/// Those of the JSON writer, which events do not give cause for.
pub fn report(events: &[Event]) -> Result<String, serde_json::Error> {
    let lines: Vec<_> = { events.iter() }
        .map(serde_json::to_string)
        .collect::<Result<_, _>>()?;
    // Only this character could end a script element, or begin a comment in it.
    let data = lines.join("\n").replace('<', "\\u003c");
    let policy = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; \
                  base-uri 'none'; form-action 'none'";
    let inline = format!(
        "<meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
         <style>\n{STYLE}</style>\n\
         <script type=\"application/x-ndjson\" id=\"events\">\n{data}\n</script>\n\
         <script>\ndocument.addEventListener('DOMContentLoaded', () => {{\n{}}});\n</script>",
        script()
    );
    Ok(INDEX.replace(LINKED, &inline))
}

#[cfg(test)]
mod tests {
    use results::record::event::What;

    use super::*;

    #[test]
    fn the_page_is_small_and_asks_nobody_else() {
        let page = report(&[]).unwrap();
        let editor = editor_page() + STYLE + &editor_script();
        for page in [&page, &editor] {
            assert!(page.len() <= 300_000, "{} bytes", page.len());
        }
        for outside in [
            "http://",
            "https://",
            "//cdn",
            "@import",
            "innerHTML",
            "eval(",
        ] {
            assert!(!page.contains(outside), "{outside}");
            assert!(!editor.contains(outside), "{outside}");
        }
    }

    #[test]
    fn data_does_not_end_the_script() {
        let what = What::Said {
            node: None,
            words: "</script><script>alert(1)</script><!--".to_owned(),
        };
        let empty = report(&[]).unwrap();
        let page = report(&[Event::new(1.0, what)]).unwrap();
        for tag in ["<script", "</script", "<!--"] {
            let count = |page: &str| page.matches(tag).count();
            assert_eq!(count(&page), count(&empty), "{tag}");
        }
    }
}

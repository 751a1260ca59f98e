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
const SCRIPTS: [&str; 10] = [
    include_str!("page/state.js"),
    include_str!("page/geometry.js"),
    include_str!("page/brush.js"),
    include_str!("page/labels.js"),
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
    use calib_core::Status;
    use results::{plot::status_colour, record::event::What};

    use super::*;

    /// A camera has one colour by day, on the page and on maps.
    #[test]
    fn the_page_has_the_colours_of_maps() {
        for status in [
            Status::Calibrated,
            Status::Weak,
            Status::Doubtful,
            Status::Refused,
            Status::Waiting,
        ] {
            let colour = status_colour(status).to_lowercase();
            let rule = format!("--{}: {colour};", status.name());
            let found = STYLE.find(&rule);
            let dark = STYLE.find("@media (prefers-color-scheme: dark)");
            assert!(found.is_some() && found < dark, "{rule}");
        }
    }

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

    /// Colours as people see them who lack one kind of cones (Machado, Oliveira and Fernandes 2009, severity 1), by
    /// rows; the first is sight with all three.
    const SIGHTS: [[[f64; 3]; 3]; 4] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ],
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ],
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ],
    ];

    /// A colour of the style, linear.
    fn colour(style: &str, name: &str) -> [f64; 3] {
        let (_, rest) = style.split_once(&format!("--{name}: #")).unwrap();
        [0, 2, 4].map(|at| {
            let share = f64::from(u8::from_str_radix(&rest[at..at + 2], 16).unwrap()) / 255.0;
            match share > 0.04045 {
                true => ((share + 0.055) / 1.055).powf(2.4),
                false => share / 12.92,
            }
        })
    }

    fn times(rows: &[[f64; 3]; 3], by: [f64; 3]) -> [f64; 3] {
        rows.map(|row| row.iter().zip(by).map(|(a, b)| a * b).sum())
    }

    const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

    /// CIE 1976 L*a*b*, D65.
    fn lab(linear: [f64; 3]) -> [f64; 3] {
        let xyz = [
            [0.4124, 0.3576, 0.1805],
            LUMINANCE,
            [0.0193, 0.1192, 0.9505],
        ];
        let [x, y, z] = times(&xyz, linear.map(|share| share.clamp(0.0, 1.0)));
        let [x, y, z] = [x / 0.9505, y, z / 1.089].map(|t| match t > 0.008856 {
            true => t.cbrt(),
            false => 7.787 * t + 16.0 / 116.0,
        });
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    #[test]
    fn colours_of_a_status_differ_for_everybody_and_can_be_read() {
        let (light, dark) = STYLE.split_once("prefers-color-scheme: dark").unwrap();
        for style in [light, dark] {
            let luminance = |name: &str| -> f64 {
                let colour = colour(style, name);
                colour.iter().zip(LUMINANCE).map(|(a, b)| a * b).sum()
            };
            let names = ["calibrated", "weak", "doubtful", "refused"];
            for (n, one) in names.into_iter().enumerate() {
                let [low, high] = {
                    let [a, b] = [luminance(one), luminance("ground")];
                    [a.min(b), a.max(b)]
                };
                let contrast = (high + 0.05) / (low + 0.05);
                assert!(contrast >= 4.5, "{one}: contrast {contrast:.1}");
                for other in &names[..n] {
                    for (number, sight) in SIGHTS.iter().enumerate() {
                        let [a, b] =
                            [one, other].map(|name| lab(times(sight, colour(style, name))));
                        let gap: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
                        let gap = gap.sqrt();
                        assert!(gap > 30.0, "{one} and {other}, sight {number}: {gap:.0}");
                    }
                }
            }
        }
    }
}

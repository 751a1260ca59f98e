//! Check of words in comments and pages: a doc comment begins as those of Rust's standard library do, and
//! comments and pages name the person or the thing that they mean.

use anyhow::{Context, Result, ensure};
use xshell::{Shell, cmd};

const FILES: [&str; 2] = ["*.rs", "*.md"];

/// Words with which no line of a doc comment begins.
const BEGINNINGS: [&str; 8] = [
    "What", "How", "Whether", "Who", "Which", "Whose", "Whom", "Nobody",
];
const BEGIN_WITH: &str =
    "begin with a noun phrase or a verb in the third person, as \"Returns ...\"";

/// Words that no comment and no page has, in lower case.
const VAGUE: [&str; 3] = ["nobody", "somebody", "whoever"];
const NAME: &str =
    "name the person or the thing, as \"the user\" or \"no camera\", or use the passive";

/// Refuses such words in all sources and pages that git tracks.
///
/// # Errors
/// Every place that has one, with the words to write there; or the files cannot be listed or read.
pub(crate) fn check(sh: &Shell) -> Result<()> {
    let files = cmd!(sh, "git ls-files -z -- {FILES...}")
        .quiet()
        .read()
        .context("the files that git tracks cannot be listed")?;
    let mut found = Vec::new();
    for name in files.split_terminator('\0') {
        // A tracked file that has just been deleted has no words.
        if sh.path_exists(name) {
            let text = sh.read_file(name)?;
            let refusals = refusals(name, &text);
            found.extend(refusals.map(|(line, refusal)| format!("{name}:{line}: {refusal}")));
        }
    }
    ensure!(
        found.is_empty(),
        "these lines need other words:\n{}",
        found.join("\n")
    );
    Ok(())
}

/// Numbers of the lines of a file with such words, from 1, and the refusals.
fn refusals(name: &str, text: &str) -> impl Iterator<Item = (usize, String)> {
    let mut scanner = name.ends_with(".rs").then(Scanner::default);
    (1..).zip(text.lines()).flat_map(move |(number, line)| {
        let found = match &mut scanner {
            Some(scanner) => scanner.refusals(line),
            None => vague(line).into_iter().collect(),
        };
        found.into_iter().map(move |refusal| (number, refusal))
    })
}

fn beginning(doc: &str) -> Option<String> {
    let first = words(doc.trim_start()).next()?;
    let begins = doc.trim_start().starts_with(first) && BEGINNINGS.contains(&first);
    begins.then(|| format!("a doc comment begins with \"{first}\": {BEGIN_WITH}"))
}

fn vague(text: &str) -> Option<String> {
    let found: Vec<_> = words(text)
        .filter(|word| VAGUE.iter().any(|vague| vague.eq_ignore_ascii_case(word)))
        .map(|word| format!("\"{word}\""))
        .collect();
    (!found.is_empty()).then(|| format!("{}: {NAME}", found.join(", ")))
}

/// Words and identifiers of a text: the name of a test is one of them.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_')
        .filter(|word| !word.is_empty())
}

/// Finds comments in the lines of a Rust file, one after the other.
#[derive(Default)]
struct Scanner {
    state: State,
    /// Code block of a doc comment, while it is open.
    block: Option<Box<Scanner>>,
}

/// Surroundings of the next character.
#[derive(Clone, Copy, Default)]
enum State {
    #[default]
    Code,
    Text,
    /// A raw string that ends with so many number signs.
    Raw(usize),
    /// Block comments within each other, this deep.
    Comment(usize),
}

impl Scanner {
    fn refusals(&mut self, line: &str) -> Vec<String> {
        let (blocks, comment) = self.comments(line);
        let doc = ["///", "//!"]
            .iter()
            .find_map(|marker| comment.strip_prefix(marker))
            .filter(|doc| !doc.starts_with('/'));
        let mut found: Vec<_> = blocks.into_iter().filter_map(vague).collect();
        let Some(doc) = doc else {
            self.block = None;
            found.extend(vague(comment));
            return found;
        };
        match (&mut self.block, doc.trim_start().starts_with("```")) {
            (Some(_), true) => self.block = None,
            (Some(block), false) => found.extend(block.refusals(doc)),
            (None, true) => self.block = Some(Box::default()),
            (None, false) => found.extend(beginning(doc).into_iter().chain(vague(doc))),
        }
        found
    }

    /// Returns the texts of block comments in a line, and the comment that ends it, with its slashes.
    fn comments<'l>(&mut self, line: &'l str) -> (Vec<&'l str>, &'l str) {
        let mut blocks = Vec::new();
        let mut at = 0;
        while let Some(next) = line[at..].chars().next() {
            let rest = &line[at..];
            at += match self.state {
                State::Code if rest.starts_with("//") && !is_in_url(&line[..at]) => {
                    return (blocks, rest);
                }
                State::Code => self.code(&line[..at], rest),
                State::Text if rest.starts_with("\\\\") || rest.starts_with("\\\"") => 2,
                State::Text => {
                    if next == '"' {
                        self.state = State::Code;
                    }
                    next.len_utf8()
                }
                State::Raw(signs) => match rest.strip_prefix('"') {
                    Some(end) if number_signs(end) >= signs => {
                        self.state = State::Code;
                        1 + signs
                    }
                    _ => next.len_utf8(),
                },
                State::Comment(depth) => {
                    let end = rest.find("*/").unwrap_or(rest.len());
                    let inner = rest.find("/*").unwrap_or(rest.len());
                    blocks.push(&rest[..end.min(inner)]);
                    self.state = match depth {
                        _ if inner < end => State::Comment(depth + 1),
                        _ if end == rest.len() => State::Comment(depth),
                        1 => State::Code,
                        _ => State::Comment(depth - 1),
                    };
                    (end.min(inner) + 2).min(rest.len())
                }
            };
        }
        (blocks, "")
    }

    /// Goes past one character of code, or past a character literal, and returns its length.
    fn code(&mut self, before: &str, rest: &str) -> usize {
        if rest.starts_with("/*") {
            self.state = State::Comment(1);
            return 2;
        }
        let mut characters = rest.chars();
        match characters.next() {
            Some('"') => {
                let marker = before.trim_end_matches('#');
                let is_raw = words(marker).last().is_some_and(|word| {
                    marker.ends_with(word) && ["r", "br", "cr"].contains(&word)
                });
                self.state = if is_raw {
                    State::Raw(before.len() - marker.len())
                } else {
                    State::Text
                };
                1
            }
            Some('\'') => match (characters.next(), characters.next()) {
                (Some('\\'), Some(escaped)) => {
                    let escape = 2 + escaped.len_utf8();
                    rest[escape..].find('\'').map_or(1, |end| escape + end + 1)
                }
                (Some(character), Some('\'')) => 2 + character.len_utf8(),
                // A lifetime or a label.
                _ => 1,
            },
            Some(character) => character.len_utf8(),
            None => 0,
        }
    }
}

/// Returns true behind the colon of a URL.
fn is_in_url(before: &str) -> bool {
    before.trim_end_matches('/').ends_with(':')
}

fn number_signs(text: &str) -> usize {
    text.len() - text.trim_start_matches('#').len()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of the lines that are refused, one for each refusal.
    fn lines(name: &str, text: &str) -> Vec<usize> {
        refusals(name, text).map(|(line, _)| line).collect()
    }

    #[track_caller]
    fn expect(text: &str, expected: &[usize]) {
        assert_eq!(lines("a.rs", text), expected, "{text}");
    }

    #[test]
    fn doc_comments_begin_with_a_noun_or_a_verb() {
        for word in BEGINNINGS {
            let is_vague = word == "Nobody";
            for marker in ["///", "//!", "    ///"] {
                let refused = if is_vague { &[1, 1][..] } else { &[1] };
                expect(&format!("{marker} {word} is it?"), refused);
            }
            let plain = if is_vague { &[1][..] } else { &[] };
            expect(&format!("// {word} is it?"), plain);
            expect(&format!("//// {word} is it?"), plain);
            expect(&format!("/// The {word} of it"), plain);
        }
        expect(
            "/// However, `How` is one.\n/// | What |\n/// how it is",
            &[],
        );
        expect("///\n///What it is", &[2]);
    }

    #[test]
    fn vague_words_are_found_in_any_case_and_whole() {
        expect(
            "// somebody\n//! Is it Whoever's?\nlet a = 1; // NOBODY",
            &[1, 2, 3],
        );
        expect("// `nobody_follows`, somebodys, no body", &[]);
        expect("let nobody = somebody(whoever); // none of them", &[]);
    }

    #[test]
    fn strings_and_urls_are_no_comments() {
        expect("let a = \"// nobody\"; // nobody", &[1]);
        expect(
            "let a = \"\\\" // nobody\"; let b = \"\\\\\"; // nobody",
            &[1],
        );
        expect("let a = \"one\n// nobody\n\"; // nobody", &[3]);
        expect("let a = \"one \\\n    // nobody\";\n// nobody", &[3]);
        expect("let a = r\"\\\"; // nobody", &[1]);
        expect("let a = br#\"\n\" // nobody\n\"#; // nobody", &[3]);
        expect("for\"a\\\" // nobody\"", &[]);
        expect(
            "let a = '\"'; // nobody\nlet b = b'\\''; // nobody",
            &[1, 2],
        );
        expect("let a = '\\u{22}'; let é = 'é'; // nobody", &[1]);
        expect("fn a<'a>(a: &'a str, b: &'a str) {} // nobody", &[1]);
        expect("'outer: loop { break 'outer; } // nobody", &[1]);
        expect("visit!(https://nobody.example, file:///nobody);", &[]);
        expect("// see https://example.org/nobody", &[1]);
    }

    #[test]
    fn block_comments_are_comments() {
        expect(
            "a(/* nobody */ nobody); /* one\nnobody /* two */\nnobody */ nobody",
            &[1, 2, 3],
        );
        expect("a(/* one */ \"/* nobody\"); // nobody", &[1]);
    }

    #[test]
    fn code_of_examples_is_code() {
        let example = [
            "/// An example:",
            "/// ```",
            "/// What::of(nobody, \"// nobody\"); // fine",
            "/// // nobody comments on this",
            "/// /// Who it is",
            "/// let open = \"",
            "/// ```",
            "/// Whether that is all",
            "/// ```",
            "fn code() {}",
            "/// nobody closed it",
        ];
        expect(&example.join("\n"), &[4, 5, 8, 11]);
    }

    #[test]
    fn pages_have_no_vague_words() {
        let page = "# What it is\n\nNobody asks whoever\n\n```\nsomebody\n```\n`nobody_asks`\n";
        assert_eq!(lines("a.md", page), [3, 6]);
    }

    #[test]
    fn refusals_name_the_words_and_what_to_write() {
        let found: Vec<_> = refusals("a.rs", "/// Who is it, Somebody or nobody?").collect();
        let [(1, begins), (1, vague)] = found.as_slice() else {
            panic!("{found:?}");
        };
        assert!(begins.contains("\"Who\"") && begins.contains("\"Returns ...\""));
        assert!(vague.contains("\"Somebody\", \"nobody\"") && vague.contains("the user"));
    }

    #[test]
    fn all_findings_of_tracked_files_are_listed() {
        let sh = Shell::new().unwrap();
        let folder = tempfile::tempdir().unwrap();
        sh.change_dir(folder.path());
        // Within a hook these variables name another repository.
        sh.set_var("GIT_WORK_TREE", folder.path());
        sh.set_var("GIT_DIR", folder.path().join(".git"));
        sh.set_var("GIT_INDEX_FILE", folder.path().join(".git/index"));
        cmd!(sh, "git init --quiet").quiet().run().unwrap();
        sh.write_file("src/a b.rs", "/// What it is\n\n/// How it is\n")
            .unwrap();
        sh.write_file("page.md", "Fine\n").unwrap();
        sh.write_file("notes.md", "nobody\n").unwrap();
        cmd!(sh, "git add src page.md").quiet().run().unwrap();
        let error = check(&sh).unwrap_err().to_string();
        let found: Vec<_> = error.lines().skip(1).collect();
        assert_eq!(found.len(), 2, "{error}");
        assert!(found[0].starts_with("src/a b.rs:1: ") && found[1].starts_with("src/a b.rs:3: "));
        sh.remove_path("src/a b.rs").unwrap();
        check(&sh).unwrap();
    }
}

//! The words of the house: how a doc comment begins, how a constant is named, and that no two types which are seen
//! outside their files share a name. Rooms whose words were gone through stand in [`ROOMS`]; a further one is added there.

use std::collections::BTreeMap;
use std::path::Path;

use super::paths::{Token, tokens};
use super::{is_test, sources};

/// Rooms whose sources keep these rules.
const ROOMS: &[&str] = &[
    "geometry/",
    "cell/",
    "planning/",
    "program/",
    "execution/",
    "inspection/",
    "wire/",
    "check/",
    "report/",
    "service/",
    "http/",
    "settings/",
    "cli/",
];
/// Words with which no paragraph of a doc comment begins.
const PARAGRAPH_OPENINGS: &[&str] = &["How", "Of", "See", "The same", "Those", "What", "Whether", "Which", "Who", "Why", "…"];
/// Words with which no doc comment begins: it stands alone where an editor shows it, so it begins with a noun or a verb.
const OPENINGS: &[&str] =
    &["And", "As", "At least", "At most", "By", "For", "From", "If", "In", "Likewise", "So", "To", "When", "Where", "With"];
/// A bound is a MAX_ or a MIN_; the field's words are those of an index.
const NAME_PARTS: &[&str] =
    &["BRIGHTEST", "FEWEST", "GREATEST", "HIGHEST", "LEAST", "LONGEST", "LOWEST", "MOST", "SHORTEST", "WIDEST"];

/// Breaches in `source`, which lies at `file` below `src/`.
fn breaches(file: &str, source: &str) -> Vec<String> {
    if !ROOMS.iter().any(|room| file.starts_with(room)) {
        return Vec::new();
    }
    let mut found = doc_breaches(source);
    found.extend(constants(source).into_iter().filter_map(|(line, name)| name_breach(&name).map(|what| (line, what))));
    found.sort();
    found.into_iter().map(|(line, what)| format!("src/{file}:{line}: {what}")).collect()
}

/// Paragraphs of doc comments that begin with a word they must not begin with.
fn doc_breaches(source: &str) -> Vec<(usize, String)> {
    let docs: Vec<Option<&str>> = source.lines().map(doc_text).collect();
    let opening = |line: usize| {
        let text = docs[line]?;
        let before = line.checked_sub(1).and_then(|before| docs[before]);
        let banned = match before {
            None => [PARAGRAPH_OPENINGS, OPENINGS].concat(),
            Some("") => PARAGRAPH_OPENINGS.to_vec(),
            Some(_) => return None,
        };
        let opening = banned.into_iter().find(|opening| begins_with(text, opening))?;
        Some((line + 1, format!("a doc comment does not begin with \"{opening}\"")))
    };
    (0..docs.len()).filter_map(opening).collect()
}

/// The text of a line of a doc comment.
fn doc_text(line: &str) -> Option<&str> {
    let line = line.trim_start();
    line.strip_prefix("///").or_else(|| line.strip_prefix("//!")).map(str::trim)
}

/// Words, not letters: "Into" does not begin with "In".
fn begins_with(text: &str, opening: &str) -> bool {
    text.strip_prefix(opening).is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
}

/// Names of constants with their lines.
fn constants(source: &str) -> Vec<(usize, String)> {
    let tokens = tokens(source);
    let named = tokens.windows(2).filter_map(|pair| match pair {
        [(_, Token::Word(keyword)), (line, Token::Word(name))] if keyword == "const" && name != "fn" => {
            Some((*line, name.clone()))
        }
        _ => None,
    });
    named.collect()
}

fn name_breach(name: &str) -> Option<String> {
    let part = name.split('_').find(|part| NAME_PARTS.contains(part))?;
    Some(format!("{name} says {part}: a bound is MAX_ or MIN_"))
}

/// Types that are seen outside the file that defines them, by name.
fn visible_types(source: &str) -> Vec<String> {
    let tokens: Vec<Token> = tokens(source).into_iter().map(|(_, token)| token).collect();
    let is_kind = |word: &str| ["struct", "enum", "trait", "type", "union"].contains(&word);
    let named = tokens.windows(3).filter_map(|three| match three {
        [before, Token::Word(kind), Token::Word(name)] if is_kind(kind) => {
            let visible = *before == Token::Word("pub".to_owned()) || *before == Token::Mark(')');
            visible.then(|| name.clone())
        }
        _ => None,
    });
    named.collect()
}

/// Files below `src/` that keep the rules, with their text.
fn files() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let read = |path: std::path::PathBuf| {
        let file = path.strip_prefix(&root).expect("below src").to_str().expect("an ASCII name").to_owned();
        (file, std::fs::read_to_string(&path).expect("the sources are readable"))
    };
    sources(&root).into_iter().map(read).collect()
}

#[test]
fn docs_begin_with_a_noun_or_a_verb_and_bounds_are_max_or_min() {
    let found: Vec<String> = files().iter().flat_map(|(file, source)| breaches(file, source)).collect();
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn no_two_visible_types_of_these_rooms_share_a_name() {
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (file, source) in files().iter().filter(|(file, _)| ROOMS.iter().any(|room| file.starts_with(room)) && !is_test(file)) {
        visible_types(source).into_iter().for_each(|name| places.entry(name).or_default().push(file.clone()));
    }
    assert!(places.len() > 200, "the scan must see the types: {}", places.len());
    let shared: Vec<_> = places.iter().filter(|(_, files)| files.len() > 1).collect();
    assert!(shared.is_empty(), "{shared:#?}");
}

/// The scanner itself: the breaches that it must find.
#[test]
fn words_are_found_and_named_by_line() {
    let lines = |source: &str| breaches("planning/plan.rs", source);
    assert_eq!(
        lines("/// Whether it is so.\nfn f() {}\n"),
        ["src/planning/plan.rs:1: a doc comment does not begin with \"Whether\""]
    );
    assert_eq!(lines("//! A module.\n//!\n//! What it does.\n").len(), 1, "every paragraph");
    assert_eq!(lines("/// For each view its row.\nfn f() {}").len(), 1);
    assert_eq!(lines("struct S {\n    /// … and the rest.\n    a: u8,\n}").len(), 1);
    assert_eq!(lines("/// The same again.\n/// See there.\nfn f() {}").len(), 1, "its first line");
    assert_eq!(lines("const MOST_VIEWS: usize = 8;"), ["src/planning/plan.rs:1: MOST_VIEWS says MOST: a bound is MAX_ or MIN_"]);
    assert_eq!(lines("\nimpl S {\n    const SUM_LEAST: f64 = 0.0;\n}").len(), 1);
    assert_eq!(visible_types("pub struct A; pub(super) enum B {} type C = u8; pub type D = u8;"), ["A", "B", "D"]);
}

/// The scanner itself: the sources that it must leave alone.
#[test]
fn other_words_and_other_rooms_are_left_alone() {
    for (file, source) in [
        ("planning/plan.rs", "/// Into the part.\n/// Whether so is said below.\nfn f() {}"),
        ("planning/plan.rs", "//! A module.\n//!\n//! With views it plans.\n"),
        ("planning/plan.rs", "// Whether it is so.\nlet text = \"/// What\";"),
        ("planning/plan.rs", "const MAX_VIEWS: usize = 8;\nconst ALMOST: u8 = 1;\nlet most = 3;\nconst fn least() {}"),
        ("lib.rs", "/// What is exported.\nconst MOST_BYTES: usize = 1;"),
    ] {
        assert_eq!(breaches(file, source), [] as [String; 0], "{source}");
    }
}

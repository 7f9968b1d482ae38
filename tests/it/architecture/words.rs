//! The words of the house: how a doc comment begins, how a constant is named, that a comment which cites the method names its
//! page, and that no two types which are seen outside their files share a name. Rooms whose words were gone through stand in
//! [`ROOMS`]; a further one is added there. Doc comments and citations of the tests are held to the same.

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
    "rendering/",
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
const OPENINGS: &[&str] = &[
    "And", "As", "At least", "At most", "By", "For", "From", "If", "In", "It", "Its", "Likewise", "None", "Not", "On", "So",
    "That", "Their", "Theirs", "There", "These", "They", "To", "When", "Where", "Whose", "With",
];
/// A bound is a MAX_ or a MIN_; the field's words are those of an index.
const NAME_PARTS: &[&str] = &[
    "BRIGHTEST",
    "FEWEST",
    "GREATEST",
    "HIGHEST",
    "LEAST",
    "LONGEST",
    "LOWEST",
    "MOST",
    "NEAREST",
    "SHORTEST",
    "SLOWEST",
    "WIDEST",
    "WORST",
];

/// Breaches in `source`, which lies at `file` below `src/`.
fn breaches(file: &str, source: &str) -> Vec<String> {
    if !ROOMS.iter().any(|room| file.starts_with(room)) {
        return Vec::new();
    }
    let mut found = comment_breaches(source);
    found.extend(constants(source).into_iter().filter_map(|(line, name)| name_breach(&name).map(|what| (line, what))));
    found.sort();
    found.into_iter().map(|(line, what)| format!("src/{file}:{line}: {what}")).collect()
}

/// Breaches in the comments of a source.
fn comment_breaches(source: &str) -> Vec<(usize, String)> {
    [doc_breaches(source), citation_breaches(source)].concat()
}

/// Paragraphs of doc comments that begin with a word they must not begin with. The text below a heading begins as a comment does.
fn doc_breaches(source: &str) -> Vec<(usize, String)> {
    let docs: Vec<Option<&str>> = source.lines().map(doc_text).collect();
    let is_heading = |text: &str| text.starts_with("# ");
    let opening = |line: usize| {
        let text = docs[line]?;
        let before = line.checked_sub(1).and_then(|before| docs[before]);
        let last = docs[..line].iter().rev().map_while(|text| *text).find(|text| !text.is_empty());
        let banned = match before {
            None => [PARAGRAPH_OPENINGS, OPENINGS].concat(),
            Some("") if !last.is_some_and(is_heading) => PARAGRAPH_OPENINGS.to_vec(),
            Some(before) if before.is_empty() || is_heading(before) => [PARAGRAPH_OPENINGS, OPENINGS].concat(),
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

/// Comments that cite the method by a section's number, which its pages do not have, or a contract, which is not in the house.
fn citation_breaches(source: &str) -> Vec<(usize, String)> {
    let comments: Vec<Option<&str>> = source.lines().map(|line| line.trim_start().strip_prefix("//")).collect();
    let citation = |line: usize| {
        let text = comments[line]?;
        let next = comments.get(line + 1).copied().flatten().unwrap_or_default().trim_start_matches(['/', '!']);
        let joined = format!("{text} {next}");
        let is_numbered = joined.match_indices('§').any(|(place, _)| {
            let before = joined[..place].trim_end_matches([' ', ',']);
            before.len() <= text.len() && before.ends_with("ethod")
        });
        (is_numbered || text.contains("(contract"))
            .then(|| (line + 1, "a comment names the page that it cites, such as planning::method::scanner".to_owned()))
    };
    (0..comments.len()).filter_map(citation).collect()
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
fn comments_of_the_tests_keep_the_same_rules() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let files = sources(&root);
    assert!(files.len() > 100, "the scan must see the tests: {}", files.len());
    let of_file = |path: &std::path::PathBuf| {
        let found = comment_breaches(&std::fs::read_to_string(path).expect("the sources are readable"));
        found.into_iter().map(|(line, what)| format!("{}:{line}: {what}", path.display())).collect::<Vec<_>>()
    };
    let found: Vec<String> = files.iter().flat_map(of_file).collect();
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
    assert_eq!(lines("struct S {\n    /// Its name.\n    a: u8,\n    /// That of a block.\n    b: u8,\n}").len(), 2);
    assert_eq!(
        lines("/// Reads.\n///\n/// # Errors\n/// Those of [`g`].\nfn f() {}"),
        ["src/planning/plan.rs:4: a doc comment does not begin with \"Those\""]
    );
    assert_eq!(lines("/// Reads.\n///\n/// # Errors\n///\n/// As [`g`].\nfn f() {}").len(), 1, "an empty line below a heading");
    assert_eq!(lines("    // Method §2: 289 mm.\n/// The rule of the method,\n/// §4, once more.\nfn f() {}").len(), 2);
    assert_eq!(lines("/// An exit code (contract: 2).\nfn f() {}").len(), 1);
    assert_eq!(lines("const WORST_SPOTS: usize = 20;").len(), 1);
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
        ("planning/plan.rs", "/// Reads.\n///\n/// # Errors\n/// Errors of [`g`].\n///\n/// It is quick.\nfn f() {}"),
        ("planning/plan.rs", "/// Method of the thesis (§3.3),\n/// a method of Knuth 3, §5.2.\nfn f() {}"),
        ("planning/plan.rs", "const MAX_VIEWS: usize = 8;\nconst ALMOST: u8 = 1;\nlet most = 3;\nconst fn least() {}"),
        ("lib.rs", "/// What is exported.\nconst MOST_BYTES: usize = 1;"),
    ] {
        assert_eq!(breaches(file, source), [] as [String; 0], "{source}");
    }
}

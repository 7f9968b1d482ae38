//! Planning makes data, and the rooms above it make the words. Two kinds of words stay: those of a check of parameters
//! (`planning/params`), and those of an error type that carries its figures (`#[error]`, `Display`).

use std::path::Path;

use super::paths::{Token, tokens};
use super::{is_test, sources};

/// Characters that a name or a label may have, beside the figures in it.
const MAX_LABEL_CHARS: usize = 20;
/// Calls whose texts are for developers.
const FOR_DEVELOPERS: &[&str] =
    &["expect", "assert", "assert_eq", "assert_ne", "debug_assert", "debug_assert_eq", "debug_assert_ne", "panic", "unreachable"];

/// Sentences in `source`, which lies at `file` below `src/`.
fn breaches(file: &str, source: &str) -> Vec<String> {
    if !file.starts_with("planning/") || file.starts_with("planning/params") || is_test(file) {
        return Vec::new();
    }
    let tokens = tokens(source);
    let (mut found, mut at) = (Vec::new(), 0);
    while let Some((line, token)) = tokens.get(at) {
        if is_sentence(token) {
            found.push(format!("src/{file}:{line}: planning makes data; {token:?} belongs into a room above it"));
        }
        at = exempt_end(&tokens, at).unwrap_or(at + 1);
    }
    found
}

fn is_sentence(token: &Token) -> bool {
    let Token::Text(text) = token else { return false };
    let around_figures: String = text.split('{').map(|piece| piece.rsplit('}').next().unwrap_or_default()).collect();
    let words: Vec<&str> = around_figures.trim_matches('"').split_whitespace().filter(|word| *word != "\\").collect();
    words.len() > 1 && words.join(" ").chars().count() > MAX_LABEL_CHARS
}

/// End of an attribute, a `Display`, a module of tests or a call for developers that begins at `at`.
fn exempt_end(tokens: &[(usize, Token)], at: usize) -> Option<usize> {
    let mark = |offset: usize, mark: char| tokens.get(at + offset).is_some_and(|(_, token)| *token == Token::Mark(mark));
    let word = |offset: usize| match tokens.get(at + offset) {
        Some((_, Token::Word(word))) => word.as_str(),
        Some((_, Token::Text(_) | Token::Mark(_))) | None => "",
    };
    let opening = match word(0) {
        "" if mark(0, '#') => 1 + usize::from(mark(1, '!')),
        "mod" if word(1) == "tests" => 2,
        "Display" if word(1) == "for" => (2..).find(|offset| mark(*offset, '{') || at + offset >= tokens.len())?,
        call if FOR_DEVELOPERS.contains(&call) => 1 + usize::from(mark(1, '!')),
        _ => return None,
    };
    ['[', '{', '('].into_iter().any(|bracket| mark(opening, bracket)).then(|| closing(tokens, at + opening))
}

/// Place behind the bracket that closes the one at `open`.
fn closing(tokens: &[(usize, Token)], open: usize) -> usize {
    let mut depth = 0_usize;
    for (at, (_, token)) in tokens.iter().enumerate().skip(open) {
        match token {
            Token::Mark('[' | '{' | '(') => depth += 1,
            Token::Mark(']' | '}' | ')') => depth -= 1,
            Token::Mark(_) | Token::Word(_) | Token::Text(_) => {}
        }
        if depth == 0 {
            return at + 1;
        }
    }
    tokens.len()
}

#[test]
fn planning_makes_no_sentences() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let found: Vec<String> = sources(&root.join("planning"))
        .iter()
        .flat_map(|path| {
            let file = path.strip_prefix(&root).expect("below src").to_str().expect("an ASCII name").to_owned();
            breaches(&file, &std::fs::read_to_string(path).expect("the sources are readable"))
        })
        .collect();
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

/// The scanner itself: sentences that it must find, and texts that it must leave alone.
#[test]
fn sentences_are_found_where_data_belong() {
    let sentence = "\"leaves nothing of the part to measure; exclude less\"";
    let found = |file: &str, source: &str| breaches(file, source).len();
    let named = breaches("planning/scene/demand.rs", &format!("\nlet detail = {sentence}.to_owned();"));
    assert!(named.len() == 1 && named[0].starts_with("src/planning/scene/demand.rs:2: "), "{named:?}");
    assert_eq!(found("planning/scene/demand.rs", &format!("format!({sentence}); #[doc = \"a\"] fn f() {{ g({sentence}) }}")), 2);
    assert_eq!(found("planning/scene/demand.rs", "\"leaves nothing \\\n    of the part to measure\""), 1);
    for (file, source) in [
        ("planning/scene/demand.rs", format!("// {sentence}\n#[error({sentence})] struct A; #![expect(x, reason = {sentence})]")),
        ("planning/scene/demand.rs", format!("impl fmt::Display for A {{ fn f() {{ write!(f, {sentence}) }} }}")),
        ("planning/scene/demand.rs", format!("x.expect({sentence}); debug_assert!(y, {sentence});")),
        ("planning/scene/demand.rs", format!("mod tests {{ fn f() {{ {sentence} }} }}")),
        (
            "planning/scene/demand.rs",
            "(\"{camera_deg}° / {projector_deg}°\", \"a_name_of_many_characters_and_no_space\")".to_owned(),
        ),
        ("planning/params/regions.rs", sentence.to_owned()),
        ("planning/setups/tests.rs", sentence.to_owned()),
        ("report/text.rs", sentence.to_owned()),
    ] {
        assert_eq!(found(file, &source), 0, "{source}");
    }
}

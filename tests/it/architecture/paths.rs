//! Just enough of Rust's grammar to see which paths a source names: comments, raw strings and lifetimes are dropped, `use`
//! trees are written out.

/// A word of the source, a text with its quotes, or one character of punctuation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Token {
    Word(String),
    Text(String),
    Mark(char),
}

/// A path as written, such as `crate::cell::Scanner`, and the line it begins on, from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Path {
    pub(super) line: usize,
    pub(super) segments: Vec<String>,
}

/// Tokens with their lines.
pub(super) fn tokens(source: &str) -> Vec<(usize, Token)> {
    let chars: Vec<char> = source.chars().collect();
    let mut found = Vec::new();
    let (mut at, mut line) = (0, 1);
    while at < chars.len() {
        let end = skip_silent(&chars, at);
        if end == at {
            let end = word_end(&chars, at);
            let word: String = chars[at..end].iter().collect();
            if end > at {
                found.push((line, Token::Word(word)));
                at = end;
            } else {
                if !chars[at].is_whitespace() {
                    found.push((line, Token::Mark(chars[at])));
                }
                line += usize::from(chars[at] == '\n');
                at += 1;
            }
        } else {
            if chars[at] == '"' {
                found.push((line, Token::Text(chars[at..end].iter().collect())));
            }
            line += chars[at..end].iter().filter(|c| **c == '\n').count();
            at = end;
        }
    }
    found
}

fn word_end(chars: &[char], at: usize) -> usize {
    let length = chars[at..].iter().take_while(|c| c.is_alphanumeric() || **c == '_').count();
    at + length
}

/// End of a comment, a literal in quotes or a lifetime that begins at `at`; `at` when none does.
fn skip_silent(chars: &[char], at: usize) -> usize {
    let starts = |text: &str| chars[at..].iter().zip(text.chars()).filter(|(a, b)| **a == *b).count() == text.len();
    if starts("//") {
        return at + chars[at..].iter().take_while(|c| **c != '\n').count();
    }
    if starts("/*") {
        return block_comment_end(chars, at);
    }
    match chars[at] {
        '"' => quoted_end(chars, at, '"'),
        '\'' => quote_or_lifetime_end(chars, at),
        'r' | 'b' | 'c' => raw_string_end(chars, at).unwrap_or(at),
        _ => at,
    }
}

fn block_comment_end(chars: &[char], mut at: usize) -> usize {
    let mut depth = 0;
    while at < chars.len() {
        match (chars[at], chars.get(at + 1)) {
            ('/', Some('*')) => (depth, at) = (depth + 1, at + 2),
            ('*', Some('/')) => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            break;
        }
    }
    at.min(chars.len())
}

fn quoted_end(chars: &[char], open: usize, quote: char) -> usize {
    let mut at = open + 1;
    while at < chars.len() && chars[at] != quote {
        at += if chars[at] == '\\' { 2 } else { 1 };
    }
    (at + 1).min(chars.len())
}

/// `'a'` and `'\n'` are characters, `'a` and `'static` lifetimes.
fn quote_or_lifetime_end(chars: &[char], at: usize) -> usize {
    let escaped = chars.get(at + 1) == Some(&'\\');
    if escaped || chars.get(at + 2) == Some(&'\'') { quoted_end(chars, at, '\'') } else { word_end(chars, at + 1) }
}

/// End of `r"…"`, `r#"…"#`, `br"…"`; `None` where the letters begin a word.
fn raw_string_end(chars: &[char], at: usize) -> Option<usize> {
    if at > 0 && (chars[at - 1].is_alphanumeric() || chars[at - 1] == '_') {
        return None;
    }
    let raw = at + chars[at..].iter().take_while(|c| matches!(c, 'b' | 'c')).count();
    let hashes = chars.get(raw + 1..)?.iter().take_while(|c| **c == '#').count();
    if chars.get(raw) != Some(&'r') || chars.get(raw + 1 + hashes) != Some(&'"') {
        return None;
    }
    let body = raw + 2 + hashes;
    let closes =
        |quote: usize| chars[quote] == '"' && chars[quote + 1..].iter().take(hashes).filter(|c| **c == '#').count() == hashes;
    (body..chars.len()).find(|quote| closes(*quote)).map(|quote| quote + 1 + hashes)
}

/// Every path of the source, `use` trees written out, in order.
pub(super) fn paths(tokens: &[(usize, Token)]) -> Vec<Path> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        let leading = matches!(&tokens[at].1, Token::Word(_));
        at = if leading { path_at(tokens, at, &[], &mut found) } else { at + 1 };
    }
    found
}

/// Reads the path that begins at `at`, below `prefix`; returns where it ends.
fn path_at(tokens: &[(usize, Token)], mut at: usize, prefix: &[String], found: &mut Vec<Path>) -> usize {
    let line = tokens[at].0;
    let mut segments = prefix.to_vec();
    loop {
        match tokens.get(at).map(|token| &token.1) {
            Some(Token::Word(word)) => segments.push(word.clone()),
            Some(Token::Mark('{')) => return group_at(tokens, at + 1, &segments, found),
            _ => break,
        }
        at += 1;
        let colons = |offset: usize| tokens.get(at + offset).map(|token| &token.1) == Some(&Token::Mark(':'));
        if !(colons(0) && colons(1)) {
            break;
        }
        at += 2;
    }
    found.push(Path { line, segments });
    at
}

/// Reads the branches of a `use` tree up to its closing brace.
fn group_at(tokens: &[(usize, Token)], mut at: usize, prefix: &[String], found: &mut Vec<Path>) -> usize {
    while let Some((_, token)) = tokens.get(at) {
        match token {
            Token::Mark('}') => return at + 1,
            Token::Word(word) if word == "as" => at += 2,
            Token::Word(_) => at = path_at(tokens, at, prefix, found),
            Token::Mark(_) | Token::Text(_) => at += 1,
        }
    }
    at
}

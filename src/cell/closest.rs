//! Names that users meant: the nearest known name to one that is unknown, for error messages.

use super::decode_message::in_plain_words;

/// Min Jaro-Winkler similarity (W. E. Winkler, 1990) at which a name is taken for a misspelling of another.
const MIN_SIMILARITY: f64 = 0.85;
/// Min length of a name that is looked for within others.
const MIN_CONTAINED: usize = 5;

/// Returns the known name that is nearest to `name`, if one is near; of equals the first. A name without a dot is also compared
/// with the last part of dotted ones, so that `target` finds `selection.target`. If none is near, the first that contains it.
#[must_use]
pub fn closest<'a>(name: &str, known: impl IntoIterator<Item = &'a str, IntoIter: Clone>) -> Option<&'a str> {
    let known = known.into_iter();
    let mut best: Option<(f64, &str)> = None;
    for other in known.clone() {
        let similarity = similarity(name, other);
        if similarity >= MIN_SIMILARITY && best.is_none_or(|(found, _)| similarity > found) {
            best = Some((similarity, other));
        }
    }
    best.map(|(_, name)| name).or_else(|| containing(name, known))
}

/// The first known name that contains this one: a model without its maker.
fn containing<'a>(name: &str, mut known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let name = plain(name);
    if name.len() < MIN_CONTAINED { None } else { known.find(|other| plain(other).contains(&name)) }
}

fn similarity(name: &str, known: &str) -> f64 {
    let whole = strsim::jaro_winkler(&plain(name), &plain(known));
    match known.rsplit_once('.') {
        Some((_, last)) if !name.contains('.') => whole.max(strsim::jaro_winkler(&plain(name), &plain(last))),
        _ => whole,
    }
}

/// The name without what is easily mistaken: capitals, hyphens.
fn plain(name: &str) -> String {
    name.to_lowercase().replace('-', "_")
}

/// Question for the end of a message, `; did you mean X?`; empty if no known name is near.
#[must_use]
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str, IntoIter: Clone>) -> String {
    closest(name, known).map_or_else(String::new, |near| format!("; did you mean {near}?"))
}

/// The message of a deserializer in plain words, with the question where it names an unknown field or value and those that it
/// knows.
#[must_use]
pub fn with_suggestion(message: &str) -> String {
    let suggestion = || {
        let rest = ["unknown field `", "unknown variant `"].iter().find_map(|start| message.strip_prefix(start))?;
        let (name, known) = rest.split_once("`, expected ")?;
        // Names stand between backticks.
        closest(name, known.split('`').skip(1).step_by(2))
    };
    let told = in_plain_words(message);
    suggestion().map_or_else(|| told.clone(), |near| format!("{told}; did you mean `{near}`?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEYS: [&str; 4] = ["selection.target", "selection.max_views", "motion.clearance_mm", "candidates.rolls_deg"];

    #[test]
    fn a_misspelled_name_finds_the_nearest_and_a_strange_one_none() {
        for (name, meant) in [
            ("selection.targt", Some("selection.target")),
            ("selection.maxViews", Some("selection.max_views")),
            ("selection.max-views", Some("selection.max_views")),
            ("motion.clearance", Some("motion.clearance_mm")),
            ("target", Some("selection.target")),
            ("max_view", Some("selection.max_views")),
            ("colour", None),
            ("", None),
        ] {
            assert_eq!(closest(name, KEYS), meant, "{name}");
        }
        assert_eq!(did_you_mean("e5-transcan", ["e05-transcan"]), "; did you mean e05-transcan?");
        assert_eq!(did_you_mean("kitchen", ["e05-transcan"]), "");
        assert_eq!(did_you_mean("IRB2600", ["hans-e05", "abb-irb2600-12-165"]), "; did you mean abb-irb2600-12-165?");
    }

    #[test]
    fn messages_of_deserializers_get_the_question() {
        let with = |message: &str| with_suggestion(message);
        assert!(with("unknown field `targt`, expected one of `target`, `goal`").ends_with("`goal`; did you mean `target`?"));
        assert!(with("unknown variant `gredy`, expected `greedy` or `lazy`").ends_with("did you mean `greedy`?"));
        assert!(with("unknown field `clearance`, expected `clearance_mm` at line 1 column 3").ends_with("`clearance_mm`?"));
        assert_eq!(with("unknown field `colour`, expected `angle`"), "unknown field `colour`, expected `angle`");
        assert_eq!(with("invalid type: integer `3`, expected an object"), "is 3; expected an object");
    }
}

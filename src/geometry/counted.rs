//! Numbers with their nouns, and lists of words, for messages.

/// A number with its noun: "1 view", "2 views".
#[must_use]
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// A list of words in a sentence: "a", "a and b", "a, b and c".
#[must_use]
pub fn listed(words: &[impl AsRef<str>]) -> String {
    let words: Vec<&str> = words.iter().map(AsRef::as_ref).collect();
    match &words[..] {
        [] => String::new(),
        [word] => (*word).to_owned(),
        [others @ .., last] => format!("{} and {last}", others.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::{counted, listed};

    #[test]
    fn one_alone_is_singular() {
        assert_eq!([0, 1, 2].map(|count| counted(count, "view")), ["0 views", "1 view", "2 views"]);
    }

    #[test]
    fn the_last_word_of_a_list_follows_and() {
        let words = ["a", "b", "c"];
        assert_eq!([0, 1, 2, 3].map(|count| listed(&words[..count])), ["", "a", "a and b", "a, b and c"]);
    }
}

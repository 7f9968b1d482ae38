//! Numbers with their nouns, for messages.

/// A number with its noun: "1 view", "2 views".
#[must_use]
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::counted;

    #[test]
    fn one_alone_is_singular() {
        assert_eq!([0, 1, 2].map(|count| counted(count, "view")), ["0 views", "1 view", "2 views"]);
    }
}

//! Numbers of things as text.

/// A number and what is counted, in the plural unless it is 1: `1 remote`, `2 remotes`.
///
/// `one` is the singular of a noun whose plural ends in s.
pub fn counted(count: usize, one: &str) -> String {
    let ending = if count == 1 { "" } else { "s" };
    format!("{count} {one}{ending}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_no_plural() {
        let counts = [0, 1, 2].map(|count| counted(count, "remote"));
        assert_eq!(counts, ["0 remotes", "1 remote", "2 remotes"]);
    }
}

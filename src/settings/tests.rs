use super::*;
use proptest::prelude::*;

fn modes(text: &str) -> Result<[Option<u8>; 8], ParseError> {
    let config: SerialConfig = text.parse()?;
    Ok([0, 1, 2, 3, 4, 5, 6, 7].map(|n| config.channels.get(&n).map(|remote| remote.mode)))
}

#[test]
fn digits_are_modes_and_x_is_not_used() {
    let z = Some(0);
    assert_eq!(
        modes("02xX9"),
        Ok([z, Some(2), None, None, Some(9), z, z, z])
    );
    assert_eq!(modes(""), Ok([z; 8]));
}

#[test]
fn invalid_modes_are_refused() {
    for text in ["0-", "000000000", "xxxxxxxxx"] {
        let error = modes(text).unwrap_err();
        assert_eq!(error.found, text);
    }
}

proptest! {
    #[test]
    fn any_text_is_parsed_or_refused(text in ".{0,12}") {
        let _ = text.parse::<SerialConfig>();
    }
}

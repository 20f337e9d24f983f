//! Texts of the library for programmers, reworded for the command line.

/// Parts of the library's error texts that address programmers, and their replacements.
const TYPED: &[(&str, &str)] = &[
    (" (`Pace::Host`)", " (--pace host)"),
    (
        "another thread period, or go on without it (`Settings::no_dpll`)",
        "another period or rate",
    ),
    (" (`Settings::watchdog`)", ""),
    (" (`Settings::bus_error_limit`)", ""),
    (" (`Settings::trace`)", ""),
    (" (`Settings::pwm`)", ""),
    (" (`Settings::pwm_hz`)", ""),
    (" (`Settings::fault_policy`)", ""),
    (" (`FaultPolicy::stale_after`)", ""),
    (
        "leave the channel out (x), or add its table with `has_discovery` false (`Settings::remotes`)",
        "it takes no part. If an update of its firmware was cut off, give `mesa update` again",
    ),
    (
        "`--without-fallback`, `Flash::without_fallback`",
        "`--without-fallback`",
    ),
    (
        " (list them with `Pins::infos`)",
        "; `mesa pins` lists them",
    ),
    (" (`FlashLayout::for_card`)", ""),
    (
        "write it before with `Configured::write_remote_parameter` while the board is configured, or at run \
         time with `Driver::write_remote_parameter`, which stops its port",
        "`mesa param set` writes it",
    ),
    ("call `rearm` first", "give the command again"),
];

/// Returns a text of the library that names arguments to type instead of items of the API.
pub fn typed(text: &impl ToString) -> String {
    let text = text.to_string();
    TYPED
        .iter()
        .fold(text, |text, (program, typed)| text.replace(program, typed))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;

    fn all(folder: &Path, text: &mut String) {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                all(&path, text);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let file = fs::read_to_string(&path).expect("a file");
                let lines = file.lines().map(str::trim_start);
                let code = lines.filter(|line| !line.starts_with("//"));
                code.for_each(|line| text.extend([line, "\n"]));
            }
        }
    }

    #[test]
    fn what_is_replaced_is_what_the_library_says() {
        let mut library = String::new();
        for sources in [
            "src",
            "../../src",
            "../mesa-wire/src",
            "../mesa-hal-sim/src",
        ] {
            let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join(sources);
            all(&sources, &mut library);
        }
        let library = library.replace("\\\n", "");
        for (program, typed) in TYPED {
            // The first match is in this file.
            assert!(
                library.matches(program).count() > 1,
                "nobody says {program}"
            );
            assert!(!typed.contains("::"));
        }
        let left = super::typed(&library);
        for line in left.lines() {
            let mut words = line.split('`').skip(1).step_by(2);
            let path = words.find(|word| {
                let is_type = word.starts_with(|letter: char| letter.is_ascii_uppercase());
                // Shown only to programs that add modules of their own.
                let is_own = ["Phase::", "EncoderSetup::"]
                    .iter()
                    .any(|own| word.starts_with(own));
                is_type && !is_own && word.contains("::") && !word.contains(' ')
            });
            assert_eq!(path, None, "{line}");
        }
    }
}

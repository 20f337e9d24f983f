//! The next step after an error or a remark, in the words of the command line.

use core::convert::Infallible;
use std::borrow::Cow;
use std::error::Error;
use std::fmt::Display;

use mesa_hal::boards::{AttachError, IdentityError};
use mesa_hal::bus::{BusError, ImageError};
use mesa_hal::discovery::Problem;
use mesa_hal::driver::{OfflineReason, RemarkKind, StopError};
use mesa_hal::ethernet::{BitfileError, EthernetError};
use mesa_hal::hal::PinError;
use mesa_hal::hostmot2::{HostMot2Error, IdentifyError};
use mesa_hal::modules::RegisterError;
use mesa_hal::remote::{ParameterError, RemoteError};
#[cfg(feature = "cli")]
use mesa_hal::runner::RealtimeError;
use mesa_hal::runner::{CommandError, ScopeError, SnapshotError};
use mesa_hal::sslbp::{PortError, StartFailure, StartFailureReason};
use mesa_hal::{Advice, CycleError, DriverError, Remark};

use crate::inventory::InventoryError;
use crate::passive::PassiveError;
use crate::setup::update::UpdateError;
use crate::setup::{CabinetError, RestoreError, SerialCabinetError, SerialError};

/// The text for a user of the command line; `None` if there is nothing to do there.
///
/// Where the library names an item of its API, the text names a command or an option instead. All
/// other advice has the text of the library.
pub fn in_command_words(advice: Advice) -> Option<Cow<'static, str>> {
    let text = match advice {
        // The command has no option for these, and no second board.
        Advice::ChooseOtherName
        | Advice::SetWatchdog
        | Advice::SetBusErrorLimit
        | Advice::SetFaultPolicy
        | Advice::SetStaleAfter
        | Advice::SetPwm
        | Advice::SetPwmFrequency
        | Advice::SetEncoderRate
        | Advice::ChoosePhase
        | Advice::SetPeriodFirst => return None,
        Advice::ListPins => "`mesa pins` lists them",
        Advice::WriteRemoteParameter => "`mesa param set` writes it",
        Advice::ListParameters => "`mesa param list` lists those that it has",
        Advice::SetInstances => "load a firmware that has more",
        Advice::LeaveDpll => "choose another period or rate",
        Advice::ChooseHostPace => "let the host pace it (`--pace host`)",
        Advice::LengthenWatchdog => "choose a longer time for the watchdog, or a shorter period",
        Advice::RearmFirst => "give the command again",
        Advice::LookAtMissing => "a line `MISSING` contains the reason, if there is one",
        Advice::AddTable => {
            "the remote takes no part; if an update of its firmware was cut off, give `mesa update` again"
        }
        Advice::StopAll => "stop all its channels; if that fails, reset the port",
        Advice::StopAllFirst => "stop all its channels first",
        Advice::IdentifyPort => "reset or identify the port first",
        Advice::UseLayoutOfBoard => "use the layout of the board that answers",
        Advice::WriteBootBlock => "`--fix-boot-block` of `mesa flash write` writes it",
        Advice::GiveStandardBitfile => {
            "give a standard bitfile, built without multiboot features; `mesa flash restore` writes an \
             image of the whole memory"
        }
        Advice::WriteFallback => {
            "write the fallback first, or, if there is no user configuration either, allow this \
             (`--without-fallback`)"
        }
        advice => return Some(advice.to_string().into()),
    };
    Some(text.into())
}

/// The facts of an error or a remark, and its advice in the words of the command line: `facts;
/// advice`, or the advice alone without facts.
pub fn with_advice(facts: impl Display, advice: Option<Advice>) -> String {
    let facts = facts.to_string();
    match advice.and_then(in_command_words) {
        Some(advice) if facts.is_empty() => advice.into_owned(),
        Some(advice) => format!("{facts}; {advice}"),
        None => facts,
    }
}

/// Returns the advice of the first of these types that the error has.
macro_rules! first_of {
    ($error:expr, $($kind:ty),* $(,)?) => {
        $(if let Some(error) = $error.downcast_ref::<$kind>() {
            return error.advice();
        })*
    };
}

/// The advice of an error of `mesa-hal` or of this package; `None` for other errors.
pub fn advice_of(error: &(dyn Error + 'static)) -> Option<Advice> {
    if let Some(error) = error.downcast_ref::<BusError>() {
        return error.advice().map(Advice::Bus);
    }
    // An error with the text of the one inside, whose advice it has too.
    if let Some(RestoreError::Cabinet(error)) = error.downcast_ref::<RestoreError<CabinetError>>() {
        return error.advice();
    }
    first_of!(
        error,
        DriverError,
        StopError,
        CycleError,
        EthernetError,
        InventoryError,
        IdentifyError,
        PortError,
        PassiveError,
        UpdateError<PortError>,
        UpdateError<SerialError>,
        SerialCabinetError,
        CabinetError,
        RestoreError<CabinetError>,
        ParameterError<Infallible>,
        PinError,
        RegisterError,
        ImageError,
        HostMot2Error,
        AttachError,
        IdentityError,
        Remark,
        RemarkKind,
        RemoteError,
        Problem,
        StartFailure,
        StartFailureReason,
        OfflineReason,
        BitfileError,
        CommandError,
        ScopeError,
        SnapshotError,
    );
    #[cfg(feature = "cli")]
    first_of!(error, RealtimeError);
    None
}

/// The facts of an error and its [advice](advice_of) in the words of the command line. A stop that
/// failed may have two: that of the remotes that were not reached, and that of the failed step.
pub fn told(error: &(dyn Error + 'static)) -> String {
    let advice = advice_of(error);
    let text = with_advice(error, advice);
    let stop = error.downcast_ref::<StopError>();
    let failed = stop.and_then(|error| error.failed.as_ref()?.advice());
    with_advice(text, failed.filter(|failed| Some(*failed) != advice))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;

    /// True for a quotation that an operator types, or finds in a file of the system.
    fn is_typed(quoted: &str) -> bool {
        let first = quoted.split(' ').next().unwrap_or_default();
        let of_system = ["mesa", "sudo", "nproc", "rtprio", "memlock", "MISSING"];
        of_system.contains(&first) || first.starts_with("--")
    }

    #[test]
    fn no_text_for_the_command_line_names_an_item_of_the_library() {
        for advice in Advice::all() {
            let Some(text) = in_command_words(advice) else {
                let item = advice.to_string();
                assert!(item.contains('`'), "{item}: only items have no other words");
                continue;
            };
            assert!(!text.contains("::"), "{text}");
            for quoted in text.split('`').skip(1).step_by(2) {
                assert!(is_typed(quoted), "{text}");
            }
        }
    }

    fn code_below(folder: &Path, text: &mut String) {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                code_below(&path, text);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let file = fs::read_to_string(&path).expect("a file");
                let lines = file.lines().map(str::trim_start);
                let code = lines.filter(|line| !line.starts_with("//"));
                code.for_each(|line| text.extend([line, "\n"]));
            }
        }
    }

    /// The facts that a user sees have no items of the library either.
    #[test]
    fn no_fact_of_the_library_names_one_of_its_items() {
        let mut library = String::new();
        for sources in [
            "src",
            "../../src",
            "../mesa-wire/src",
            "../mesa-hal-sim/src",
        ] {
            let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join(sources);
            code_below(&sources, &mut library);
        }
        let library = library.replace("\\\n", "");
        let texts: Vec<_> = Advice::all()
            .map(|advice| format!("\"{advice}\""))
            .collect();
        for line in library.lines() {
            if texts.iter().any(|text| line.contains(text)) {
                continue;
            }
            let mut words = line.split('`').skip(1).step_by(2);
            let item = words.find(|word| {
                let is_type = word.starts_with(|letter: char| letter.is_ascii_uppercase());
                // Shown only to programs that add modules of their own.
                let is_own = word.starts_with("Phase::");
                is_type && !is_own && word.contains("::") && !word.contains(' ')
            });
            assert_eq!(item, None, "{line}");
        }
    }

    #[test]
    fn errors_have_their_advice_in_words_that_can_be_typed() {
        let error = DriverError::NotPaced { why: "too slow" };
        assert_eq!(
            told(&error),
            "the board cannot pace the cycle: too slow; let the host pace it (`--pace host`)"
        );
        assert_eq!(told(&std::fmt::Error), std::fmt::Error.to_string());
        let hidden = with_advice("a fact", Some(Advice::SetWatchdog));
        assert_eq!(hidden, "a fact");
        let alone = with_advice("", Some(Advice::RearmFirst));
        assert_eq!(alone, "give the command again");
    }
}

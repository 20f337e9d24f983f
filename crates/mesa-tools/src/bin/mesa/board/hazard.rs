//! What a pin may do to a machine.

use mesa_hal::hal::{HalType, PinInfo, Role};

/// Possible effect of a pin on a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hazard {
    /// Ordinary output.
    None,
    Analog,
    DriveEnable,
    Watchdog,
    /// Not an output: changes how outputs or inputs work.
    Making,
}

/// Classifies a pin by its name, because unknown remotes have enables as well; in doubt, as more
/// hazardous.
pub fn hazard(info: &PinInfo) -> Hazard {
    let last = info.name.rsplit('.').next().unwrap_or_default();
    let harmless = [
        "index-enable",
        "probe-enable",
        "quad-error-enable",
        "latch-enable",
    ];
    let is_enable = last.contains("ena") && !harmless.contains(&last);
    let inverts = last.starts_with("invert") || last.ends_with("-invert");
    let is_number = info.hal_type != HalType::Bit && info.role != Role::Input;
    if info.name.contains(".watchdog.") {
        Hazard::Watchdog
    } else if info.role.is_param() || inverts || is_number && is_rate(&info.name) {
        Hazard::Making
    } else if is_enable {
        Hazard::DriveEnable
    } else if is_number || last.starts_with("analogout") {
        Hazard::Analog
    } else {
        Hazard::None
    }
}

/// True if a number sets the rate of a module of the board, not the value of an output.
fn is_rate(name: &str) -> bool {
    let modules = [".dpll.", ".encoder.", ".ssr.", ".inmux.", ".packet-"];
    modules.iter().any(|module| name.contains(module))
}

//! The computer of a measurement, for files that are looked at later.

use std::fs;

/// This computer: its name and its kernel.
pub fn computer() -> String {
    let text = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let [name, release] = ["hostname", "osrelease"]
        .map(|file| text(&format!("/proc/sys/kernel/{file}")).trim().to_owned());
    let version = text("/proc/version");
    let kind = if version.contains("PREEMPT_RT") {
        ", PREEMPT_RT"
    } else {
        ""
    };
    format!("{name}, Linux {release}{kind}")
}

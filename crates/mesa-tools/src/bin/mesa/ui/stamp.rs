//! Date and computer of a measurement, in files and pictures that are looked at later.

use std::fs;
use std::time::{SystemTime, UNIX_EPOCH};

/// Date and time in UTC, as in ISO 8601 with whole seconds: `2026-11-26T04:02:26Z`. A time before
/// 1970 counts as 1970.
pub fn utc(time: SystemTime) -> String {
    humantime::format_rfc3339_seconds(time.max(UNIX_EPOCH)).to_string()
}

/// The same for a printed page: `2026-11-26 04:02:26 UTC`.
pub fn on_paper(time: SystemTime) -> String {
    utc(time).replace('T', " ").replace('Z', " UTC")
}

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

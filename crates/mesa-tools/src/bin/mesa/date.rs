//! Dates in files and pictures.

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

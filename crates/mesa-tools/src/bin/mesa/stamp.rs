//! Time and computer of a measurement, for files that are looked at later.

use std::fs;
use std::time::SystemTime;

/// A point in time as text: `2026-11-26 14:03:59 UTC`.
pub fn date(time: SystemTime) -> String {
    const DAY: u64 = 86_400;
    let since = time.duration_since(SystemTime::UNIX_EPOCH);
    let seconds = since.map_or(0, |since| since.as_secs());
    let (days, rest) = (seconds / DAY, seconds % DAY);
    let (year, month, day) = civil(days);
    let (hour, minute, second) = (rest / 3600, rest / 60 % 60, rest % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

/// Year, month and day of a number of days after 1970-01-01.
fn civil(days: u64) -> (u64, u64, u64) {
    const FOUR_CENTURIES: u64 = 146_097;
    // Years that begin in March have their leap day at the end.
    let from_march = days + 719_468;
    let (era, day) = (from_march / FOUR_CENTURIES, from_march % FOUR_CENTURIES);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day_of_month = day - (153 * month + 2) / 5 + 1;
    let is_next = month >= 10;
    let month = if is_next { month - 9 } else { month + 3 };
    (era * 400 + year + u64::from(is_next), month, day_of_month)
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn days_of_all_kinds_of_years_are_right() {
        for (seconds, text) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_399, "2000-02-28 23:59:59 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (951_868_800, "2000-03-01 00:00:00 UTC"),
            (1_795_701_839, "2026-11-26 14:03:59 UTC"),
            (4_102_444_800, "2100-01-01 00:00:00 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
        ] {
            let time = SystemTime::UNIX_EPOCH + Duration::from_secs(seconds);
            assert_eq!(date(time), text);
        }
    }
}

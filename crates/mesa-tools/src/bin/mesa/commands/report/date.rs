//! The date of a report.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

const SECONDS_OF_A_DAY: u64 = 86_400;
/// Days in 400 years of the Gregorian calendar.
const DAYS_OF_400_YEARS: u64 = 146_097;
/// Days from 1 March 0000 to 1 January 1970.
const DAYS_BEFORE_1970: u64 = 719_468;

/// Formats a time as `2026-03-01 12:30 UTC`. A time before 1970 is shown as the begin of 1970.
pub fn text(time: SystemTime) -> String {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
    let seconds = since.as_secs();
    let (days, second) = (seconds / SECONDS_OF_A_DAY, seconds % SECONDS_OF_A_DAY);
    let [year, month, day] = date(days);
    let (hour, minute) = (second / 3600, second / 60 % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02} UTC")
}

/// Year, month and day of a day after 1 January 1970. Years are counted from 1 March, so that a
/// leap day is the last day of its year.
fn date(days: u64) -> [u64; 3] {
    let days = days + DAYS_BEFORE_1970;
    let (cycle, day) = (days / DAYS_OF_400_YEARS, days % DAYS_OF_400_YEARS);
    // Leap days before this day: each 4 years without each 100 years.
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    // Months from March on have 31, 30, 31, 30, 31 days, again and again.
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let year = 400 * cycle + year;
    if month < 10 {
        [year, month + 3, day]
    } else {
        [year + 1, month - 9, day]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, expected) in [
            (0, "1970-01-01 00:00 UTC"),
            (951_782_399, "2000-02-28 23:59 UTC"),
            (951_782_400, "2000-02-29 00:00 UTC"),
            (951_868_800, "2000-03-01 00:00 UTC"),
            (1_709_210_096, "2024-02-29 12:34 UTC"),
            (1_735_689_599, "2024-12-31 23:59 UTC"),
            (4_107_542_400, "2100-03-01 00:00 UTC"),
        ] {
            assert_eq!(text(UNIX_EPOCH + Duration::from_secs(seconds)), expected);
        }
    }

    #[test]
    fn each_day_follows_the_day_before() {
        let mut last = date(0);
        for days in 1..200_000 {
            let [year, month, day] = date(days);
            let follows = [
                last == [year, month, day - 1],
                day == 1 && last[1] == month - 1 && last[0] == year && last[2] >= 28,
                [month, day] == [1, 1] && last == [year - 1, 12, 31],
            ];
            assert_eq!(
                follows.iter().filter(|follows| **follows).count(),
                1,
                "{days}: {last:?}"
            );
            last = [year, month, day];
        }
    }
}

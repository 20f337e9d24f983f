//! The values of a recording, as CSV.

use std::fmt::Write;

use mesa_hal::runner::Scope as Recorder;

use super::Recording;

/// A line for each cycle: seconds and cycles since the trigger, the values, and 1 in the cycle of
/// the trigger.
pub fn of(recording: &Recording) -> String {
    let Recording {
        infos,
        scope,
        trigger,
        ..
    } = recording;
    // A name may contain a comma, but cannot contain a quote.
    let names = infos.iter().map(|info| format!("\"{}\"", info.name));
    let names = names.collect::<Vec<_>>().join(",");
    let mut text = format!("time_s,cycle,{names},\"trigger: {trigger}\"\n");
    for (seconds, row) in times(scope).zip(scope.rows()) {
        let _ = write!(text, "{seconds:.9},{}", row.offset);
        for value in row.values() {
            text.push(',');
            if let Some(value) = value {
                let _ = write!(text, "{}", value.as_f64());
            }
        }
        let _ = writeln!(text, ",{}", u8::from(row.offset == 0));
    }
    text
}

/// Seconds since the trigger, for each cycle.
pub fn times(scope: &Recorder) -> impl Iterator<Item = f64> + '_ {
    let trigger = scope.rows().find(|row| row.offset == 0);
    let trigger = trigger.map_or(0, |row| row.time.as_nanos() as i64);
    let rows = scope.rows();
    rows.map(move |row| (row.time.as_nanos() as i64 - trigger) as f64 / 1e9)
}

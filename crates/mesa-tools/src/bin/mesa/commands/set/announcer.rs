//! Announcements while an output is set: when it is on, how long it stays so, when it is off again.

use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use mesa_hal::Rounded;
use mesa_hal::hal::PinInfo;

use super::plan::{JogPlan, Progress};
use crate::board::named;
use crate::ui::output::{complain, status};

/// Announcements that wait to be printed; those that find no room are left out.
const ROOM: usize = 16;

/// Announces the progress of a jog on standard error. Prints in a thread of its own, because a
/// terminal that accepts no text must not hold up the cycle.
pub struct Announcer {
    printer: SyncSender<Announcement>,
    thread: JoinHandle<()>,
    last: Progress,
    /// Announcements of the output with its value and with its safe value.
    is_set: String,
    is_safe: String,
}

enum Announcement {
    Event(String),
    Left(u64),
}

impl Announcer {
    pub fn start(info: &PinInfo, plan: &JogPlan) -> Self {
        let (printer, announcements) = sync_channel(ROOM);
        let thread = std::thread::spawn(move || {
            for announcement in announcements {
                match announcement {
                    Announcement::Event(text) => complain(text),
                    Announcement::Left(seconds) => status(format_args!("mesa: {seconds} s left")),
                }
            }
        });
        let pin = named::with_place(info);
        let [value, safe] =
            [plan.output.value, plan.output.safe].map(|value| named::with_unit(info, value));
        Self {
            printer,
            thread,
            last: Progress::Waiting,
            is_set: format!("mesa: {pin} is {value}, for {}", Rounded(&plan.time)),
            is_safe: format!("mesa: {pin} is {safe} again"),
        }
    }

    /// Announces what has changed; call in each cycle.
    pub fn show(&mut self, progress: Progress) {
        let announcement = match (self.last, progress) {
            (Progress::Waiting, Progress::Set { .. }) => {
                Some(Announcement::Event(self.is_set.clone()))
            }
            (Progress::Set { left: last }, Progress::Set { left }) => {
                let seconds = begun_seconds(left);
                let is_new = seconds > 0 && seconds < begun_seconds(last);
                is_new.then_some(Announcement::Left(seconds))
            }
            (Progress::Waiting | Progress::Set { .. }, Progress::Safe) => {
                Some(Announcement::Event(self.is_safe.clone()))
            }
            _ => None,
        };
        self.last = progress;
        if let Some(announcement) = announcement {
            // A terminal that accepts no text misses it.
            let _ = self.printer.try_send(announcement);
        }
    }

    /// Returns after everything is printed.
    pub fn end(self) {
        drop(self.printer);
        let _ = self.thread.join();
    }
}

/// Seconds that are left, the begun one included.
const fn begun_seconds(left: Duration) -> u64 {
    let begun = if left.subsec_nanos() == 0 { 0 } else { 1 };
    left.as_secs() + begun
}

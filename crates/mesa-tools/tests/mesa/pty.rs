//! A simulated card on a serial port: a pseudoterminal with the card at its other end.

use crate::interop::realtime_thread;
use std::fs::{File, OpenOptions};
use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use mesa_hal_sim::SerialFace;
use mesa_hal_sim::devices::SimDevice;
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Interval between two checks for the end.
const LOOK: Duration = Duration::from_millis(2);

/// Interval between two checks if another thread still has the device: less than a character takes.
const HAND_OVER: Duration = Duration::from_micros(20);

/// A card with its jumper in the setup position, in real time, until it is dropped.
pub struct Card {
    /// Path that a host opens.
    pub path: String,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    // An open end keeps the settings and the sent characters.
    _slave: File,
}

struct Shared {
    device: Mutex<(Box<dyn SimDevice>, u64)>,
    /// Threads that wait for the device, or have it.
    waiting: AtomicUsize,
    stop: AtomicBool,
}

impl Card {
    pub fn start(device: impl SimDevice) -> Self {
        Self::start_boxed(Box::new(device))
    }

    pub fn start_boxed(mut device: Box<dyn SimDevice>) -> Self {
        crate::interop::behind_the_feature();
        device.set_setup_jumper(0, true);
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudoterminal");
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        fcntl_setfl(&master, OFlags::NONBLOCK).unwrap();
        let path = ptsname(&master, Vec::new()).unwrap();
        let path = path.into_string().unwrap();
        let slave = OpenOptions::new().read(true).write(true).open(&path);
        let slave = slave.unwrap();
        let mut settings = tcgetattr(&slave).unwrap();
        settings.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &settings).unwrap();
        let shared = Arc::new(Shared {
            device: Mutex::new((device, 0)),
            waiting: AtomicUsize::new(0),
            stop: AtomicBool::new(false),
        });
        let thread = std::thread::spawn({
            let (shared, slave) = (Arc::clone(&shared), slave.try_clone().unwrap());
            move || serve(&shared, &slave, master)
        });
        Self {
            path,
            shared,
            thread: Some(thread),
            _slave: slave,
        }
    }

    /// Gives access to the device and its time, for checks and changes.
    pub fn with<T>(&self, look: impl FnOnce(&mut dyn SimDevice, u64) -> T) -> T {
        self.shared.waiting.fetch_add(1, Ordering::AcqRel);
        let result = {
            let mut device = self.shared.device();
            let (device, now) = &mut *device;
            look(&mut **device, *now)
        };
        self.shared.waiting.fetch_sub(1, Ordering::AcqRel);
        result
    }

    /// Value of a parameter in the card itself.
    pub fn parameter(&self, name: &str) -> u64 {
        let found = self.with(|device, _| device.parameters());
        let found = found.into_iter().find(|(found, _)| found == name);
        found.expect("it has this parameter").1
    }

    pub fn power_cycle(&self) {
        self.with(|device, now| {
            device.set_power(now, false);
            device.set_power(now, true);
        });
    }
}

impl Shared {
    fn device(&self) -> MutexGuard<'_, (Box<dyn SimDevice>, u64)> {
        self.device.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn serve(shared: &Shared, slave: &File, master: OwnedFd) {
    realtime_thread();
    let mut face = SerialFace::new(File::from(master));
    while !shared.stop.load(Ordering::Relaxed) {
        // A mutex is not fair, and this thread has the higher priority.
        while shared.waiting.load(Ordering::Acquire) > 0 {
            std::thread::sleep(HAND_OVER);
        }
        // The line has the rate that the host has set, whatever the card's rate.
        face.set_baud_rate(tcgetattr(slave).unwrap().input_speed());
        {
            let mut device = shared.device();
            face.step(&mut *device.0, LOOK).expect("the port works");
            device.1 = face.now();
        }
        // To the cards of other tests, which have the same priority.
        std::thread::yield_now();
    }
}

impl Drop for Card {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

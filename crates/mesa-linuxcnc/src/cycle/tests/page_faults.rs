//! The page faults of a thread.

use std::fs::File;
use std::os::unix::fs::FileExt;

/// Counter of the kernel.
pub struct PageFaults(File);

impl PageFaults {
    pub fn of_this_thread() -> Self {
        Self(File::open("/proc/thread-self/stat").expect("Linux has it"))
    }

    /// The number so far, minor and major ones. Does not allocate.
    pub fn count(&self) -> u64 {
        let mut buffer = [0; 1024];
        let length = self.0.read_at(&mut buffer, 0).expect("it is read");
        let text = std::str::from_utf8(&buffer[..length]).expect("ASCII");
        // The second field is the name in brackets, in which there may be spaces.
        let (_, fields) = text.rsplit_once(')').expect("a name");
        // Fields 10 and 12, see proc(5).
        let mut fields = fields.split_ascii_whitespace().skip(7).step_by(2);
        let mut next = || fields.next().expect("a field").parse::<u64>();
        next().expect("a number") + next().expect("a number")
    }
}

#[test]
fn page_that_is_new_is_a_fault() {
    let faults = PageFaults::of_this_thread();
    let before = faults.count();
    let mut pages = vec![0_u8; 1 << 22];
    for page in pages.chunks_mut(4096) {
        page[0] = std::hint::black_box(1);
    }
    assert!(faults.count() > before);
    assert_eq!(faults.count(), faults.count());
}

//! The age of the data of a transfer.

use super::*;

#[test]
fn age_of_transfer_data_starts_at_the_begin_of_its_write() {
    let mut rig = Rig::new();
    rig.read();
    let begun = rig.now;
    rig.machine.sending(begun);
    // The host is suspended before the write returns.
    rig.now = rig.now.after(Duration::from_millis(5));
    rig.write();
    assert_eq!(rig.read().started, begun);
}

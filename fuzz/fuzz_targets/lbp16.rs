//! Any request, with any reply: the parser of LBP16 ends, and reads no byte twice.

#![no_main]

use libfuzzer_sys::fuzz_target;
use mesa_wire::lbp16::Operations;

fuzz_target!(|data: &[u8]| {
    let Some((&split, data)) = data.split_first() else {
        return;
    };
    let (request, reply) = data.split_at(usize::from(split).min(data.len()));
    let operations = Operations::new(request);
    // Each takes at least two bytes; an error is the last item.
    assert!(operations.clone().count() <= request.len().div_ceil(2));
    let written: usize = operations.clone().flatten().map(|one| one.data.len()).sum();
    assert!(written <= request.len());
    let _ = operations.reply_len();
    let mut read = 0;
    for one in operations.with_reply(reply).flatten() {
        let _ = one.elements().count();
        read += one.read.len();
    }
    assert!(read <= reply.len());
});

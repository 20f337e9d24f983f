//! Replays the recorded transcripts of the real gateware against the simulator, and compares.
//!
//! `GATEWARE_TRANSCRIPTS` selects another directory than `tests/transcripts`. One line for each
//! file contains the number of comparisons; any difference, and any file that cannot be read
//! completely, is a failure.

#[path = "../common/mod.rs"]
mod common;
mod damage;
mod doit_time;
mod format;
mod fpga_side;
mod phase;
mod remote_side;
mod shifted;
mod wire_log;

use common::recording::replay_all;
use common::recording::sslbp::Transcript;

/// The transcripts that belong to the project.
const DIRECTORY: &str = "transcripts";

#[test]
fn simulated_fpga_and_remotes_do_what_was_recorded() {
    replay_all(
        "GATEWARE_TRANSCRIPTS",
        DIRECTORY,
        |transcript: &Transcript| {
            Ok(vec![
                ("FPGA side, ", fpga_side::replay(transcript)),
                ("remote side, ", remote_side::replay(transcript)),
            ])
        },
    );
}

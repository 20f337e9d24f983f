//! The inputs: `InMux` and `InM`.

use mesa_hal_sim::{gtag, machines};

use crate::Replay;
use crate::bench::{Bench, FpgaBench};
use crate::common::recording::Outcome;
use crate::runner::{self, Rules, Watch};
use crate::transcript::{Event, Level, Transcript};

/// Everything exact, to the clock.
pub const REPLAY: Replay = replay;

const INPUTS: usize = 16;

/// The inputs of a 7I97, or of one with a pin for each input.
struct InputsBench {
    inner: FpgaBench,
}

fn replay(transcript: &Transcript) -> Outcome {
    let is_in_m = transcript.entries.iter().any(|entry| {
        matches!(
            entry.event,
            Event::Write { register, .. } | Event::Read { register, .. }
                if register.kind.gtag == gtag::IN_M
        )
    });
    let firmware = if is_in_m {
        machines::firmware_7i97_inm_outm(1)
    } else {
        machines::firmware_7i97(1)
    };
    let mut inner = FpgaBench::new(firmware);
    // The bench's inputs of InMux begin at 0, where current pulls them; those of InM are pulled up.
    for input in 0..INPUTS {
        inner.fpga.set_input(input, true);
    }
    let rules = Rules {
        watch: Watch::ToLastLine,
        ..Rules::default()
    };
    runner::replay(transcript, &mut InputsBench { inner }, rules)
}

impl Bench for InputsBench {
    fn inner(&mut self) -> &mut FpgaBench {
        &mut self.inner
    }

    /// A pin of `InM`, which is 1 while current flows.
    fn drive(&mut self, pin: &str, level: Level) -> Result<(), String> {
        let input = pin
            .strip_prefix("IN")
            .and_then(|digits| digits.parse().ok());
        let input = input.filter(|&input: &usize| input < INPUTS);
        let input = input.ok_or_else(|| format!("{pin} is no input"))?;
        self.inner.fpga.set_input(input, level != Level::Low);
        Ok(())
    }

    /// An input of `InMux`, which an opto-isolator pulls low while current flows.
    fn input(&mut self, input: u8, level: bool) -> Result<(), String> {
        if usize::from(input) >= INPUTS {
            return Err(format!("there is no input {input}"));
        }
        self.inner.fpga.set_input(usize::from(input), !level);
        Ok(())
    }
}

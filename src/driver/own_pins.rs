//! Pins of the application's own.

use super::{Board, Configured, Plan};
use crate::bus::{Clock, RegisterBus};
#[cfg(doc)]
use crate::hal::Pins;
use crate::hal::{PinError, PinMaker};

impl<B: RegisterBus + Clock> Board<B> {
    /// Makes pins of the application's own, whose names begin with `prefix` and a dot: values that
    /// it shows, and commands that it takes. A snapshot or a scope has them with the pins of the
    /// board, of the same cycle; other threads send commands to them as to any pin.
    ///
    /// | made as | set by | read by |
    /// |---|---|---|
    /// | [`input`](PinMaker::input) | the application: [`Pins::show`] | snapshots, scopes |
    /// | [`output`](PinMaker::output) | other threads: [`CommandSender::set`] | the application: [`Pins::command`] |
    /// | [`inout`](PinMaker::inout), as a command that is taken once | other threads | the application: [`Pins::take`] |
    /// | [`setting`](PinMaker::setting) | other threads, or the application | the application: [`Pins::param`] |
    ///
    /// Their types are those of the HAL. No fault makes them safe or not valid; their age is the
    /// time since the application has shown a value.
    ///
    /// ```
    /// use std::ops::ControlFlow;
    /// use mesa_hal::{Board, InOut, Input, Settings, runner::Runner};
    /// use mesa_hal_sim::machines;
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let bus = machines::six_axes_7i92(Default::default());
    /// let mut board = Board::identify(bus, Settings::default())?;
    /// let mut own = board.own_pins("mill")?;
    /// let error: Input<f64> = own.input("x.following-error")?; // mill.x.following-error
    /// let home: InOut<bool> = own.inout("x.home")?;
    /// let mut runner = Runner::new(board.start()?);
    /// let (snapshots, commands) = (runner.snapshot(), runner.commands(64));
    /// let number = commands.set(home, true)?;
    /// let mut is_homing = false;
    /// runner.run(|cycle| {
    ///     is_homing |= cycle.pins_mut().take(home);
    ///     cycle.pins_mut().show(error, 0.25);
    ///     if cycle.number < 10 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    /// }).stopped?;
    /// assert!(is_homing);
    /// assert_eq!(snapshots.read()?.read(error).value, 0.25);
    /// # let _ = number;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`PinError::BadName`] without a prefix; [`PinError::NameTaken`] for one that begins with the
    /// board's name.
    ///
    /// [`CommandSender::set`]: crate::runner::CommandSender::set
    pub fn own_pins(&mut self, prefix: &str) -> Result<PinMaker<'_>, PinError> {
        self.0.plan.own_pins(prefix)
    }
}

impl<B: RegisterBus + Clock> Configured<B> {
    /// As [`Board::own_pins`].
    ///
    /// # Errors
    /// As [`Board::own_pins`].
    pub fn own_pins(&mut self, prefix: &str) -> Result<PinMaker<'_>, PinError> {
        self.0.plan.own_pins(prefix)
    }
}

impl Plan {
    fn own_pins(&mut self, prefix: &str) -> Result<PinMaker<'_>, PinError> {
        let group = match self.own {
            Some(group) => group,
            None => *self.own.insert(self.pins.add_own_group()),
        };
        self.pins.own_maker(group, prefix, &self.name)
    }
}

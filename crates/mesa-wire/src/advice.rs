//! The next step after an error, a remark or an event, apart from its facts.

use core::error::Error;
use core::fmt;

/// The next step after an error, a remark or an event: a topic, and a text for programmers.
///
/// The `Display` of an error contains facts: the operation, the place, the expected and the found
/// value. [`MesaError::advice`] returns the next step, if there is one. `Display` of an advice is
/// its text, as part of a sentence. A program with other words for its users has them by
/// [`topic`](Self::topic); [`WithAdvice`] joins facts and advice.
///
/// ```
/// use mesa_wire::bus::{BusError, LinkError};
/// use mesa_wire::{AdviceTopic, MesaError};
///
/// let error = BusError::from(LinkError::Unreachable);
/// let advice = error.advice().expect("a next step");
/// assert_eq!(advice.topic(), AdviceTopic::Network);
/// assert!(advice.text().starts_with("check that the network interface is up"));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Advice {
    topic: AdviceTopic,
    text: &'static str,
}

impl Advice {
    /// An advice with this text: a phrase without a capital letter and without a full stop.
    pub const fn new(topic: AdviceTopic, text: &'static str) -> Self {
        Self { topic, text }
    }

    /// The topic, by which a program finds words of its own.
    pub const fn topic(self) -> AdviceTopic {
        self.topic
    }

    /// The text for programmers, which may name items of the library.
    pub const fn text(self) -> &'static str {
        self.text
    }
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.text)
    }
}

/// Defines a public constant for each advice, and a slice of all of them.
///
/// ```
/// use mesa_wire::{AdviceTopic, advice_texts};
///
/// advice_texts! {
///     /// All of them.
///     ALL;
///     CHECK_BRIDGE: Board, "check the power of the bridge";
/// }
///
/// assert_eq!(CHECK_BRIDGE.topic(), AdviceTopic::Board);
/// assert_eq!(ALL.len(), 1);
/// ```
#[macro_export]
macro_rules! advice_texts {
    ($(#[$attribute:meta])* $all:ident; $($name:ident: $topic:ident, $text:literal;)*) => {
        $(
            #[doc = concat!("\"", $text, "\".")]
            pub const $name: $crate::Advice =
                $crate::Advice::new($crate::AdviceTopic::$topic, $text);
        )*

        $(#[$attribute])*
        pub const $all: &[$crate::Advice] = &[$($name),*];
    };
}

/// Topic of an [`Advice`].
///
/// Where the texts of a topic name items of the library, another program needs words of its own for
/// it; the other topics group texts that fit everywhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum AdviceTopic {
    /// The names of pins and parameters.
    PinNames,
    /// The names of the parameters of a remote.
    ParameterNames,
    /// Writing a parameter of a remote.
    RemoteParameter,
    /// Another value, scale, time, pin, name or instance.
    Choice,
    /// A serial port that is switched off and on.
    PortSwitch,
    /// Re-arming the outputs.
    Rearm,
    /// A watchdog that has bitten.
    WatchdogBite,
    /// A board that was reset.
    BoardReset,
    /// A connection that was lost.
    ConnectionLost,
    /// Starting the driver again.
    Restart,
    /// Trying again.
    Retry,
    /// The application's calls in each cycle.
    Calls,
    /// A setting of the driver, or the name or the number of a board.
    Settings,
    /// The frequency of PWM generators.
    PwmFrequency,
    /// The number of instances in use.
    Instances,
    /// The board's DPLL.
    Dpll,
    /// Pacing by the board or by the host.
    HostPace,
    /// A period that is set before the first write.
    StartPeriod,
    /// The time of a watchdog.
    WatchdogTime,
    /// The configuration of a serial port.
    SerialPort,
    /// The configuration of a channel.
    Channel,
    /// The code of a module outside of this crate, or of a program that uses a bus directly.
    Module,
    /// Computer, thread and period of the cycle.
    Host,
    /// Priority, memory and CPUs of the thread.
    Realtime,
    /// Power, cable, address and slot of the board.
    Board,
    /// Network interface and switches.
    Network,
    /// The firewall of the computer.
    Firewall,
    /// A program that uses the same board.
    OtherProgram,
    /// The firmware of the board, its memory, and files for it.
    Firmware,
    /// A remark about a remote that is missing.
    Missing,
    /// Cable and power of a remote.
    RemotePower,
    /// A remote: its place, field power, line, mode, firmware and watchdog.
    Remote,
    /// A remote without a description.
    NoTable,
    /// The state of a serial port.
    PortState,
    /// Homing of axes.
    Homing,
    /// The layout of the board's memory, by its card.
    FlashLayout,
    /// The boot block of the board's memory.
    BootBlock,
    /// The fallback configuration of the board.
    Fallback,
    /// A bitfile without multiboot features.
    StandardBitfile,
}

/// An error of these packages: facts in `Display`, and the next step apart from them.
///
/// ```
/// use std::fmt;
///
/// use mesa_wire::bus::{BusError, LinkError};
/// use mesa_wire::{Advice, AdviceTopic, MesaError};
///
/// /// Words for the users of this program.
/// fn words(advice: Advice) -> Option<&'static str> {
///     match advice.topic() {
///         AdviceTopic::Network => Some("look at the network plug"),
///         _ => Some(advice.text()),
///     }
/// }
///
/// let error = BusError::from(LinkError::Unreachable);
/// let text = error.with_advice().in_words(words).to_string();
/// assert!(text.ends_with("; look at the network plug"));
/// ```
pub trait MesaError: Error + 'static {
    /// The next step, if there is one; none for an error that does not define this method.
    ///
    /// # Real time
    /// Constant time, no allocation.
    fn advice(&self) -> Option<Advice> {
        None
    }

    /// A second step: an error of two failures has that of each.
    fn further_advice(&self) -> Option<Advice> {
        None
    }

    /// Writes the words for an advice of this error. An error replaces words in capitals, such as
    /// `ADDRESS`, by its values: a command then can be typed as it is.
    ///
    /// # Errors
    /// Those of the formatter.
    fn write_advice(&self, words: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(words)
    }

    /// Joins the facts and the advice: `facts; advice`.
    fn with_advice(&self) -> WithAdvice<'_>
    where
        Self: Sized,
    {
        WithAdvice::of(self)
    }
}

/// Facts, and the [`Advice`] that belongs to them: `facts; advice`.
#[derive(Clone, Copy)]
pub struct WithAdvice<'a> {
    /// `None` for the advice alone.
    facts: Option<&'a dyn fmt::Display>,
    /// The error that writes the advice.
    error: Option<&'a dyn MesaError>,
    advice: [Option<Advice>; 2],
    words: fn(Advice) -> Option<&'static str>,
}

impl<'a> WithAdvice<'a> {
    /// Joins facts and advice; without advice the text is that of the facts.
    pub fn new(facts: &'a dyn fmt::Display, advice: Option<Advice>) -> Self {
        Self {
            facts: Some(facts),
            error: None,
            advice: [advice, None],
            words: |advice| Some(advice.text()),
        }
    }

    /// The facts of an error, and its advice.
    pub fn of(error: &'a dyn MesaError) -> Self {
        Self {
            error: Some(error),
            advice: [error.advice(), error.further_advice()],
            ..Self::new(error, None)
        }
    }

    /// Leaves the facts out.
    #[must_use]
    pub fn alone(self) -> Self {
        Self {
            facts: None,
            ..self
        }
    }

    /// Sets the words for each advice; an advice without words is left out.
    #[must_use]
    pub fn in_words(self, words: fn(Advice) -> Option<&'static str>) -> Self {
        Self { words, ..self }
    }
}

impl fmt::Display for WithAdvice<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        if let Some(facts) = self.facts {
            facts.fmt(f)?;
            separator = "; ";
        }
        let [first, second] = self.advice.map(|advice| advice.and_then(self.words));
        let different = second.filter(|_| second != first);
        for text in [first, different].into_iter().flatten() {
            f.write_str(core::mem::replace(&mut separator, "; "))?;
            match self.error {
                Some(error) => error.write_advice(text, f)?,
                None => f.write_str(text)?,
            }
        }
        Ok(())
    }
}

impl fmt::Debug for WithAdvice<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&format_args!("{self}"), f)
    }
}

#[cfg(feature = "std")]
impl MesaError for std::io::Error {}

impl MesaError for fmt::Error {}

impl MesaError for core::convert::Infallible {}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::format;
    use alloc::string::ToString;

    #[derive(Debug, thiserror::Error)]
    #[error("the stop failed")]
    struct Stop([Option<Advice>; 2]);

    impl MesaError for Stop {
        fn advice(&self) -> Option<Advice> {
            self.0[0]
        }

        fn further_advice(&self) -> Option<Advice> {
            self.0[1]
        }

        fn write_advice(&self, words: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(&words.replace("CARD", "7i77.0.1"))
        }
    }

    #[test]
    fn error_fills_its_values_in_with_and_without_facts() {
        let power = Advice::new(AdviceTopic::RemotePower, "check the power of CARD");
        let again = Advice::new(AdviceTopic::Retry, "try again");
        let error = Stop([Some(power), Some(again)]);
        let advice = "check the power of 7i77.0.1; try again";
        let joined = error.with_advice();
        assert_eq!(joined.to_string(), format!("the stop failed; {advice}"));
        assert_eq!(joined.alone().to_string(), advice);
    }

    #[test]
    fn equal_advice_is_written_once() {
        let power = Advice::new(AdviceTopic::RemotePower, "check its power");
        let again = Advice::new(AdviceTopic::Retry, "try again");
        for (advice, text) in [
            ([None, None], "the stop failed"),
            ([Some(power), None], "the stop failed; check its power"),
            ([Some(power); 2], "the stop failed; check its power"),
            ([None, Some(again)], "the stop failed; try again"),
            (
                [Some(power), Some(again)],
                "the stop failed; check its power; try again",
            ),
        ] {
            assert_eq!(Stop(advice).with_advice().to_string(), text);
        }
    }

    #[test]
    fn advice_without_words_is_left_out() {
        let power = Advice::new(AdviceTopic::RemotePower, "check its power");
        let error = Stop([Some(power), None]);
        let none = error.with_advice().in_words(|_| None);
        assert_eq!(none.to_string(), "the stop failed");
        let other = error.with_advice().in_words(|_| Some("look"));
        assert_eq!(other.to_string(), "the stop failed; look");
    }
}

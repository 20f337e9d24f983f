//! A bus whose type is chosen at run time.
#![expect(
    clippy::result_large_err,
    reason = "an error keeps its text without allocation, because the cycle must not allocate"
)]

use super::{
    Access, AccessList, BoardIdentity, BusAdvice, BusError, BusErrorKind, BusStatistics, Clock,
    Effort, Hold, Instant, RegisterBus, Reply,
};
use alloc::boxed::Box;
use core::fmt::{self, Write};
use core::time::Duration;

/// A bus of any type, chosen at run time: for programs that take a board or a simulated one.
///
/// ```
/// use mesa_wire::bus::DynBus;
/// # use mesa_wire::bus::{Access, Clock, Instant, RegisterBus};
/// # use core::{convert::Infallible, time::Duration};
/// # struct Board;
/// # struct Simulator;
/// # macro_rules! bus { ($($name:ident)*) => { $(
/// # impl RegisterBus for $name {
/// #     type Error = Infallible;
/// #     fn exchange(&mut self, _: &[Access], _: &mut [u32]) -> Result<(), Infallible> { Ok(()) }
/// # }
/// # impl Clock for $name {
/// #     fn now(&mut self) -> Instant { Instant::default() }
/// #     fn wait(&mut self, _: Duration) {}
/// # } )* } }
/// # bus!(Board Simulator);
///
/// fn open(is_simulated: bool) -> DynBus {
///     if is_simulated {
///         DynBus::new(Simulator)
///     } else {
///         DynBus::new(Board)
///     }
/// }
/// # open(true).read(0x100).unwrap();
/// # open(false).read(0x100).unwrap();
/// ```
///
/// # Real time
/// As the bus inside, with one indirect call for each call. Errors are copied without allocation.
pub struct DynBus(Box<dyn ErasedBus>);

impl DynBus {
    /// Hides the type of a bus.
    pub fn new<B: RegisterBus + Clock + Send + 'static>(bus: B) -> Self {
        Self(Box::new(Erased(bus)))
    }
}

impl fmt::Debug for DynBus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DynBus").finish_non_exhaustive()
    }
}

/// An error of a [`DynBus`]: kind, text and advice of the error of the bus inside.
#[derive(Clone, Copy)]
pub struct DynBusError {
    kind: BusErrorKind,
    advice: Option<BusAdvice>,
    text: [u8; LONGEST],
    len: u16,
}

/// Bytes of text that an error keeps; the rest is cut off.
const LONGEST: usize = 320;

impl DynBusError {
    fn new(error: &impl BusError) -> Self {
        let mut this = Self {
            kind: error.kind(),
            advice: error.advice(),
            text: [0; LONGEST],
            len: 0,
        };
        // A text that is too long is cut off.
        let _ = write!(this, "{error}");
        this
    }

    fn text(&self) -> &str {
        let text = self.text.get(..self.len.into()).unwrap_or_default();
        core::str::from_utf8(text).unwrap_or_default()
    }
}

impl Write for DynBusError {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = self.text.get_mut(self.len.into()..).unwrap_or_default();
        let mut fits = text.len().min(room.len());
        while !text.is_char_boundary(fits) {
            fits = fits.saturating_sub(1);
        }
        if let (Some(to), Some(from)) = (room.get_mut(..fits), text.as_bytes().get(..fits)) {
            to.copy_from_slice(from);
        }
        self.len = self.len.saturating_add(fits as u16);
        if fits == text.len() {
            Ok(())
        } else {
            Err(fmt::Error)
        }
    }
}

impl PartialEq for DynBusError {
    fn eq(&self, other: &Self) -> bool {
        (self.kind, self.advice) == (other.kind, other.advice) && self.text() == other.text()
    }
}

impl Eq for DynBusError {}

impl fmt::Debug for DynBusError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DynBusError")
            .field("kind", &self.kind)
            .field("text", &self.text())
            .finish_non_exhaustive()
    }
}

impl fmt::Display for DynBusError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.text())
    }
}

impl core::error::Error for DynBusError {}

impl BusError for DynBusError {
    fn kind(&self) -> BusErrorKind {
        self.kind
    }

    fn advice(&self) -> Option<BusAdvice> {
        self.advice
    }
}

trait ErasedBus: RegisterBus<Error = DynBusError> + Clock + Send {}

impl<B: RegisterBus<Error = DynBusError> + Clock + Send> ErasedBus for B {}

struct Erased<B>(B);

fn erase<T, E: BusError>(result: Result<T, E>) -> Result<T, DynBusError> {
    result.map_err(|error| DynBusError::new(&error))
}

impl<B: RegisterBus> RegisterBus for Erased<B> {
    type Error = DynBusError;

    fn can_hold(&self) -> bool {
        self.0.can_hold()
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), DynBusError> {
        erase(self.0.exchange(accesses, words))
    }

    fn prepare(
        &mut self,
        accesses: &[Access],
        hold: Option<Hold>,
    ) -> Result<AccessList, DynBusError> {
        erase(self.0.prepare(accesses, hold))
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), DynBusError> {
        erase(self.0.start(list, words))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, DynBusError> {
        erase(self.0.finish(list, words))
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), DynBusError> {
        erase(self.0.write_all(accesses, words))
    }

    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        self.0.set_cycle(period, deadline);
    }

    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, DynBusError> {
        erase(self.0.board(effort))
    }

    fn statistics(&self) -> BusStatistics {
        self.0.statistics()
    }
}

impl<B: Clock> Clock for Erased<B> {
    fn now(&mut self) -> Instant {
        self.0.now()
    }

    fn wait(&mut self, duration: Duration) {
        self.0.wait(duration);
    }

    fn sleep(&mut self, duration: Duration) {
        self.0.sleep(duration);
    }
}

impl RegisterBus for DynBus {
    type Error = DynBusError;

    fn can_hold(&self) -> bool {
        self.0.can_hold()
    }

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), DynBusError> {
        self.0.exchange(accesses, words)
    }

    fn prepare(
        &mut self,
        accesses: &[Access],
        hold: Option<Hold>,
    ) -> Result<AccessList, DynBusError> {
        self.0.prepare(accesses, hold)
    }

    fn start(&mut self, list: &AccessList, words: &[u32]) -> Result<(), DynBusError> {
        self.0.start(list, words)
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, DynBusError> {
        self.0.finish(list, words)
    }

    fn write_all(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), DynBusError> {
        self.0.write_all(accesses, words)
    }

    fn set_cycle(&mut self, period: Duration, deadline: Option<Duration>) {
        self.0.set_cycle(period, deadline);
    }

    fn board(&mut self, effort: Effort) -> Result<BoardIdentity, DynBusError> {
        self.0.board(effort)
    }

    fn statistics(&self) -> BusStatistics {
        self.0.statistics()
    }
}

impl Clock for DynBus {
    fn now(&mut self) -> Instant {
        self.0.now()
    }

    fn wait(&mut self, duration: Duration) {
        self.0.wait(duration);
    }

    fn sleep(&mut self, duration: Duration) {
        self.0.sleep(duration);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::{String, ToString};

    #[derive(Debug)]
    struct Failing(&'static str);

    impl fmt::Display for Failing {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(self.0)
        }
    }

    impl core::error::Error for Failing {}

    impl BusError for Failing {
        fn kind(&self) -> BusErrorKind {
            BusErrorKind::Lost
        }
    }

    struct Bus(&'static str);

    impl RegisterBus for Bus {
        type Error = Failing;

        fn exchange(&mut self, _: &[Access], words: &mut [u32]) -> Result<(), Failing> {
            if self.0.is_empty() {
                words.fill(7);
                return Ok(());
            }
            Err(Failing(self.0))
        }

        fn can_hold(&self) -> bool {
            true
        }
    }

    impl Clock for Bus {
        fn now(&mut self) -> Instant {
            Instant::from_nanos(5)
        }

        fn wait(&mut self, _: Duration) {}
    }

    #[test]
    fn a_bus_works_as_before_when_its_type_is_hidden() {
        let mut bus = DynBus::new(Bus(""));
        assert_eq!(bus.read(0x100), Ok(7));
        let list = bus
            .prepare(&[Access::read(0x100, 0, 1)], None)
            .expect("a list");
        let mut words = [0];
        assert_eq!(bus.run(&list, &mut words), Ok(Reply::CERTAIN));
        assert_eq!(
            (words, bus.now().as_nanos(), bus.can_hold()),
            ([7], 5, true)
        );
    }

    #[test]
    fn an_error_keeps_its_kind_and_its_text() {
        let mut bus = DynBus::new(Bus("no reply within 800 us: check the cable"));
        let error = bus.read(0x100).expect_err("it fails");
        assert_eq!(error.kind(), BusErrorKind::Lost);
        assert_eq!(error.to_string(), "no reply within 800 us: check the cable");
    }

    #[test]
    fn a_text_that_is_too_long_is_cut_between_characters() {
        let text: String = core::iter::repeat_n('µ', LONGEST).collect();
        let error = DynBusError::new(&Failing(text.leak()));
        assert_eq!(error.to_string().chars().count(), LONGEST / 2);
    }
}

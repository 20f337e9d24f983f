//! HostMot2: cookie, IDROM, module and pin descriptors, and one file for each kind of module.

mod dpll;
mod encoder;
mod error;
mod gtag;
mod identify;
mod idrom;
mod in_mux;
mod io_port;
mod led;
mod module;
mod outputs;
mod pin;
mod pwm;
mod watchdog;

pub use dpll::{Dpll, DpllConfig, DpllError, DpllSetup, phase_error_us};
pub use encoder::{
    ControlWord, CountWord, Encoder, EncoderConfig, EncoderReading, EncoderSample, Encoders,
    LatchRequest, LatchTimer, MuxSkew, TickRate, VelocityEstimator,
};
pub use error::{IdentifyError, IdromPart, LocateError, MissingModule, Warning};
pub use gtag::{Gtag, GtagList};
pub use identify::HostMot2;
pub use idrom::{Idrom, Name8};
pub use in_mux::{InMux, InMuxConfig, InMuxControl, MpgCounters, MpgModes, MpgWord};
pub use io_port::{GpioSetup, IoPinError, IoPorts, PinPlace, PortPlan, PortSetup};
pub use led::{LedWord, Leds};
pub use module::{ModuleClock, ModuleDescriptor, ModuleError, RegisterBlock};
pub use outputs::{OutM, Ssr, SsrRate};
pub use pin::PinDescriptor;
pub use pwm::{PdmRate, PwmGenerators, PwmMode, PwmOutput, PwmRate, PwmScale, PwmValue, PwmWidth};
pub use watchdog::{Watchdog, WatchdogStatus, WatchdogTime};

//! Kinds of modules.

use core::fmt;

/// The general function tag of a module: its kind.
///
/// `Display` prints name and number: `Watchdog (02)`. Tags without a name in this crate are kept.
///
/// Source: FACTS 13.1; HostMot2's public list of tags.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Gtag(pub u8);

macro_rules! gtags {
    ($($(#[$doc:meta])* $constant:ident = $value:literal, $name:literal;)*) => {
        impl Gtag {
            $($(#[$doc])* pub const $constant: Self = Self($value);)*

            /// The name, if the tag is known.
            pub const fn name(self) -> Option<&'static str> {
                match self.0 {
                    $($value => Some($name),)*
                    _ => None,
                }
            }
        }
    };
}

gtags! {
    /// No module: ends the list of descriptors.
    NONE = 0x00, "None";
    /// Interrupt logic.
    IRQ = 0x01, "IRQ";
    /// Watchdog.
    WATCHDOG = 0x02, "Watchdog";
    /// I/O port: the pins themselves.
    IO_PORT = 0x03, "IOPort";
    /// Quadrature counter.
    ENCODER = 0x04, "Encoder";
    /// Step generator.
    STEPGEN = 0x05, "StepGen";
    /// PWM and PDM generator.
    PWM = 0x06, "PWM";
    /// SPI.
    SPI = 0x07, "SPI";
    /// SSI absolute encoder.
    SSI = 0x08, "SSI";
    /// UART, transmitter.
    UART_TX = 0x09, "UARTTransmit";
    /// UART, receiver.
    UART_RX = 0x0A, "UARTReceive";
    /// Translation RAM.
    TRANSLATION_RAM = 0x0B, "TranslationRAM";
    /// Quadrature counter on multiplexed pins.
    MUXED_ENCODER = 0x0C, "MuxedEncoder";
    /// The multiplexer's select pin.
    MUX_SELECT = 0x0D, "MuxSelect";
    /// Buffered SPI.
    BUFFERED_SPI = 0x0E, "BSPI";
    /// Decoded buffered SPI.
    DECODED_SPI = 0x0F, "DBSPI";
    /// The DPLL of old firmware.
    DPLL = 0x10, "DPLL";
    /// Multiplexed quadrature counter, index mask variant.
    MUXED_ENCODER_MIM = 0x11, "MuxedEncoderMIM";
    /// Select pin of the index mask variant.
    MUX_SELECT_MIM = 0x12, "MuxSelectMIM";
    /// Three-phase PWM.
    THREE_PHASE_PWM = 0x13, "ThreePhasePWM";
    /// Waveform generator.
    WAVEGEN = 0x14, "WaveGen";
    /// Data acquisition FIFO.
    DAQ_FIFO = 0x15, "DAQFIFO";
    /// Binary oscillator.
    BINARY_OSCILLATOR = 0x16, "BinOsc";
    /// Demand-mode DMA.
    DMA = 0x17, "DMDMA";
    /// BISS absolute encoder.
    BISS = 0x18, "BISS";
    /// Fanuc absolute encoder.
    FABS = 0x19, "FABS";
    /// The DPLL of HostMot2, which samples in step with the thread.
    HM2DPLL = 0x1A, "HM2DPLL";
    /// Packet UART, transmitter.
    PACKET_UART_TX = 0x1B, "PktUARTTransmit";
    /// Packet UART, receiver.
    PACKET_UART_RX = 0x1C, "PktUARTReceive";
    /// Scaler counter.
    SCALER = 0x1D, "ScalerCounter";
    /// Multiplexed inputs.
    IN_MUX = 0x1E, "InMux";
    /// Filtered inputs, one pin each.
    IN_M = 0x23, "InM";
    /// Data painter.
    DATA_PAINTER = 0x2A, "DPainter";
    /// XY2-100 galvanometer interface.
    XY2_MOD = 0x2B, "XY2Mod";
    /// RC servo PWM.
    RC_PWM = 0x2C, "RCPWM";
    /// Plain outputs.
    OUT_M = 0x2D, "OutM";
    /// Local I/O port.
    LOCAL_IO_PORT = 0x40, "LIOPort";
    /// Board LEDs.
    LED = 0x80, "LED";
    /// Resolver.
    RESOLVER = 0xC0, "Resolver";
    /// Smart serial (SSLBP) with three interface registers for a channel.
    SSERIAL = 0xC1, "SSerial";
    /// Twiddler.
    TWIDDLER = 0xC2, "Twiddler";
    /// Solid state relay outputs.
    SSR = 0xC3, "SSR";
    /// Charge pump drive.
    CP_DRIVE = 0xC4, "CPDrive";
    /// Delta-sigma A/D converter.
    DSAD = 0xC5, "DSAD";
    /// Smart serial (SSLBP) with seven interface registers for a channel.
    SSERIAL_B = 0xC6, "SSerialB";
    /// One shot.
    ONE_SHOT = 0xC7, "OneShot";
    /// Period measurement.
    PERIOD = 0xC8, "Period";
}

impl fmt::Display for Gtag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name() {
            Some(name) => write!(f, "{name} ({:02X})", self.0),
            None => write!(f, "unknown module ({:02X})", self.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    #[test]
    fn every_tag_prints_its_number_and_known_ones_their_name() {
        assert_eq!(Gtag::WATCHDOG.to_string(), "Watchdog (02)");
        assert_eq!(Gtag::SSERIAL_B.to_string(), "SSerialB (C6)");
        assert_eq!(Gtag(0x99).to_string(), "unknown module (99)");
    }
}

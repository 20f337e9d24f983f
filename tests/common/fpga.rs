//! Manual set-up of a simulated FPGA, without a driver.

use mesa_hal::bus::RegisterBus;
use mesa_hal_sim::SimFpga;

/// Sets direction and alternate source of every pin that a module drives.
pub fn set_up_pins(fpga: &mut SimFpga) {
    let width = fpga.firmware().port_width as usize;
    let mut words = vec![0u32; fpga.firmware().ports as usize];
    for (number, pin) in fpga.firmware().pins.iter().enumerate() {
        words[number / width] |= u32::from(pin.pin & 0x80 != 0) << (number % width);
    }
    for (port, word) in (0u16..).zip(words) {
        fpga.write(0x1200 + 4 * port, word).unwrap();
        fpga.write(0x1100 + 4 * port, word).unwrap();
    }
}

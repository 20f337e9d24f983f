//! An Ethernet board driven through smoltcp, a network stack for microcontrollers, instead of a
//! socket of an operating system.
//!
//! ```sh
//! cargo run --example microcontroller
//! ```
//!
//! `link.rs` and `drive.rs` are what a controller needs. `cable.rs` takes the place of its network
//! interface and its clock: a simulated 7I97, on virtual time.

mod cable;
mod drive;
mod link;

use std::error::Error;

use mesa_hal_sim::{BoardConfig, Motor, SimBoard, machines};

use cable::Cable;

fn main() -> Result<(), Box<dyn Error>> {
    let fpga = machines::six_axes_7i97(Motor::default());
    let cable = Cable::to(SimBoard::new(BoardConfig::new("7I97"), fpga));
    drive::drive(cable.host(), cable.clone())?;
    let moved = cable.look(|board| board.gateware_mut().motor(0).map(|motor| motor.position()));
    println!("1 s at 1.5 V moved the axis by {moved:.1?} units");
    Ok(())
}

//! A module that this crate does not know, in the cycle of a driver: all of it is in `pulser.rs`.
//!
//! ```sh
//! cargo run --example own_module
//! ```
//!
//! The board is a simulated one whose gateware has the module; in between, the board is reset.

mod gateware;
mod pulser;

use std::error::Error;
use std::time::Duration;

use mesa_hal::bus::Clock;
use mesa_hal::driver::{Board, Driver, Settings};
use mesa_hal_sim::SimFpga;
use pulser::Pulser;

const PERIOD: Duration = Duration::from_millis(1);

fn main() -> Result<(), Box<dyn Error>> {
    let mut board = Board::identify(
        gateware::board(),
        Settings {
            period: PERIOD,
            ..Settings::default()
        },
    )?;
    let pulser = board.add(Pulser::register)?;
    let pulser = pulser.ok_or("the firmware has no pulse generator")?;
    let mut driver = board.start()?;

    driver.pins_mut().set(pulser.frequency, 5_000.0);
    run(&mut driver, 100)?;
    println!("after 100 ms: {:?}", driver.pins().read(pulser.count));

    driver.bus_mut().reload();
    run(&mut driver, 10)?;
    println!("after a reset: {:?}", driver.board_state());

    // An operator does this after seeing the reset.
    while driver.rearm()?.waiting > 0 {
        run(&mut driver, 1)?;
    }
    driver.pins_mut().set(pulser.frequency, 5_000.0);
    run(&mut driver, 100)?;
    println!("after 100 ms more: {:?}", driver.pins().read(pulser.count));
    let (_, stopped) = driver.shutdown();
    Ok(stopped?)
}

fn run(driver: &mut Driver<SimFpga>, cycles: u32) -> Result<(), Box<dyn Error>> {
    for _ in 0..cycles {
        let _ = driver.read()?;
        driver.write()?;
        driver.bus_mut().wait(PERIOD);
    }
    Ok(())
}

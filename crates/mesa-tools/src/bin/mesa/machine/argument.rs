//! A machine as the value of an option.

use std::path::Path;
use std::str::FromStr;

use super::boards::Board;
use super::description::{Description, Remote};
use super::file;

/// The text form is the board, or a file with the identity memory of its firmware (ends in `.txt`),
/// followed by remotes separated by commas; or a file that describes the whole machine (ends in
/// `.toml`).
impl FromStr for Description {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let path = Path::new(text);
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            return file::read(path);
        }
        let mut parts = text.split(',');
        let name = parts.next().unwrap_or_default();
        let extension = Path::new(name).extension();
        if extension.is_some_and(|extension| extension == "txt") {
            return Self::of_firmware(Path::new(name), remotes(parts)?);
        }
        let board = Board::named(name).ok_or_else(|| {
            let names = Board::names();
            format!(
                "no machine `{name}`; there are {names}, descriptions: FILE.toml, and images of \
                 firmwares: FILE.txt"
            )
        })?;
        Self::of_board(board, remotes(parts)?)
    }
}

fn remotes<'a>(parts: impl Iterator<Item = &'a str>) -> Result<Vec<Remote>, String> {
    parts.map(str::parse).collect()
}

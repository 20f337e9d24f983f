//! Files that become a part of the page.

use std::fs;
use std::path::Path;

use crate::ui::context::Failure;
use crate::ui::{files, stamp};

/// Longest file that becomes a part of the page, in bytes.
const LONGEST: u64 = 4 << 20;

/// Reads a file; `None` if it is no text.
pub fn read(path: &Path) -> Result<Option<String>, Failure> {
    Ok(String::from_utf8(files::read(path, LONGEST)?).ok())
}

/// Name of a file, and when it was written.
pub fn written_at(path: &Path) -> String {
    let modified = fs::metadata(path).and_then(|found| found.modified()).ok();
    let modified = modified.map(|time| format!(", written {}", stamp::on_paper(time)));
    format!("{}{}", path.display(), modified.unwrap_or_default())
}

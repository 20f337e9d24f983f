//! Unsafe code is in three files, few, and each block has its reason.

use std::fs;
use std::path::{Path, PathBuf};

/// Unsafe blocks and implementations, and symbols that other programs look up.
const BLOCKS: [(&str, usize, usize); 3] =
    [("exports.rs", 0, 23), ("ffi.rs", 7, 0), ("memory.rs", 8, 0)];

fn sources(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, files);
        } else {
            files.push(path);
        }
    }
}

#[test]
fn unsafe_blocks_are_counted_and_have_reasons() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    assert!(files.len() > 8);
    for file in files {
        let name = file.strip_prefix(&root).expect("below it").to_str();
        let name = name.expect("UTF-8");
        let text = fs::read_to_string(&file).expect("a source");
        let lines: Vec<_> = text.lines().map(str::trim).collect();
        let is_block = |line: &str| line.contains("unsafe {") || line.starts_with("unsafe impl");
        let blocks = lines.iter().filter(|line| is_block(line)).count();
        let symbols = lines
            .iter()
            .filter(|line| line.starts_with("#[unsafe("))
            .count();
        let expected = BLOCKS.iter().find(|(file, ..)| *file == name);
        let (_, some, other) = *expected.unwrap_or(&("", 0, 0));
        assert_eq!((blocks, symbols), (some, other), "{name}");
        for (number, _) in lines.iter().enumerate().filter(|(_, line)| is_block(line)) {
            let mut before = lines[..number].iter().rev().take(6);
            let has_reason = before.any(|line| line.starts_with("// SAFETY: "));
            assert!(has_reason, "{name}, line {}", number + 1);
        }
    }
}

//! Unsafe code is in one file, and each block has its reason.

use std::fs;
use std::path::Path;

/// Unsafe blocks and `unsafe impl` of `src/mapping.rs`.
const BLOCKS: usize = 6;

#[test]
fn unsafe_code_is_in_one_file_and_each_block_has_its_reason() {
    let mut seen = 0;
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("src")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = fs::read_to_string(&path).expect("UTF-8");
            let blocks = count(&text);
            if path.ends_with("src/mapping.rs") {
                let reasons = text.matches("// SAFETY: ").count();
                assert_eq!((blocks, reasons), (BLOCKS, BLOCKS), "{}", path.display());
            } else {
                assert_eq!(blocks, 0, "{}", path.display());
                assert!(!text.contains("unsafe_code"), "{}", path.display());
            }
            seen += 1;
        }
    }
    assert!(seen > 5, "{seen} files");
}

/// Lines of code with the keyword.
fn count(text: &str) -> usize {
    let code = text
        .lines()
        .map(str::trim)
        .filter(|line| !line.starts_with("//"));
    code.filter(|line| {
        line.split(|c: char| !c.is_alphanumeric() && c != '_')
            .any(|word| word == "unsafe")
    })
    .count()
}

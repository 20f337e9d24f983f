//! No two files of a package need each other, except those listed here with their reason.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// The packages, by the files in which their modules begin.
const ROOTS: [&str; 7] = [
    "src/lib.rs",
    "crates/mesa-wire/src/lib.rs",
    "crates/mesa-hal-sim/src/lib.rs",
    "crates/mesa-tools/src/lib.rs",
    "crates/mesa-tools/src/bin/mesa/main.rs",
    "crates/mesa-linuxcnc/src/lib.rs",
    "crates/mesa-pci/src/lib.rs",
];

/// A path of modules, from the root of a package.
type ModulePath = Vec<String>;

/// An import: the path after `use`, and whether it hands the name on (`pub use`).
#[derive(Clone, Debug)]
struct Import {
    path: ModulePath,
    is_handed_on: bool,
}

/// The modules of a package, with the names that each imports.
#[derive(Debug, Default)]
struct Package {
    files: BTreeMap<ModulePath, String>,
    imports: BTreeMap<ModulePath, Vec<Import>>,
}

impl Package {
    fn read(root: &str) -> Self {
        let mut package = Self::default();
        package.add(&[], &crate::root().join(root), root);
        package
    }

    fn add(&mut self, module: &[String], file: &Path, name: &str) {
        let text = fs::read_to_string(file).expect("a source");
        let code = code_of(&text);
        let stem = Path::new(name);
        let is_face = ["mod.rs", "lib.rs", "main.rs"]
            .iter()
            .any(|face| stem.ends_with(face));
        let folder = if is_face {
            stem.parent().expect("a folder").to_path_buf()
        } else {
            stem.with_extension("")
        };
        self.files.insert(module.to_vec(), name.to_string());
        self.imports.insert(module.to_vec(), imports(&code));
        for child in children(&code) {
            let places = [format!("{child}.rs"), format!("{child}/mod.rs")];
            let place = places.iter().map(|place| folder.join(place));
            let found = place
                .into_iter()
                .find(|place| crate::root().join(place).exists());
            if let Some(found) = found {
                let path = [module, &[child]].concat();
                let name = found.to_str().expect("a name").to_string();
                self.add(&path, &crate::root().join(&found), &name);
            }
        }
    }

    /// The path from the root of the package; `None` for a name of another package.
    fn absolute(&self, module: &[String], path: &[String]) -> Option<ModulePath> {
        let first = path.first()?;
        match first.as_str() {
            "crate" => Some(path[1..].to_vec()),
            "self" => Some([module, &path[1..]].concat()),
            "super" => {
                let up = path.iter().take_while(|part| *part == "super").count();
                let above = &module[..module.len().checked_sub(up)?];
                Some([above, &path[up..]].concat())
            }
            _ => {
                let child = [module, std::slice::from_ref(first)].concat();
                let is_child = self.files.contains_key(&child);
                is_child.then(|| [module, path].concat())
            }
        }
    }

    /// The module that defines what a path names, followed through the modules that hand it on.
    fn definer(&self, path: &[String], seen: &mut BTreeSet<ModulePath>) -> Option<ModulePath> {
        if !seen.insert(path.to_vec()) {
            return None;
        }
        let depth = (0..=path.len())
            .rev()
            .find(|&n| self.files.contains_key(&path[..n]))?;
        let (module, rest) = path.split_at(depth);
        let Some(name) = rest.first() else {
            return Some(module.to_vec());
        };
        let handed_on = self.imports[module]
            .iter()
            .filter(|import| import.is_handed_on);
        for import in handed_on.filter(|import| import.path.last() == Some(name)) {
            let next = self.absolute(module, &import.path);
            let found = next.and_then(|next| self.definer(&next, seen));
            if found.is_some() {
                return found;
            }
        }
        Some(module.to_vec())
    }

    /// The files that each file imports from.
    fn edges(&self) -> BTreeMap<&str, BTreeSet<&str>> {
        let mut edges = BTreeMap::<_, BTreeSet<_>>::new();
        for (module, imports) in &self.imports {
            let own = self.files[module].as_str();
            let needed = edges.entry(own).or_default();
            for import in imports.iter().filter(|import| !import.is_handed_on) {
                let path = self.absolute(module, &import.path);
                let definer = path.and_then(|path| self.definer(&path, &mut BTreeSet::new()));
                let file = definer.map(|definer| self.files[&definer].as_str());
                needed.extend(file.filter(|file| *file != own));
            }
        }
        edges
    }
}

/// The code of a source before its unit tests, without comments.
fn code_of(text: &str) -> String {
    let mut code = String::new();
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        let line = line.split("//").next().unwrap_or_default();
        let is_test = line.trim_start().starts_with("#[cfg(") && line.contains("test");
        let next = lines.peek().copied().unwrap_or_default();
        if is_test && next.contains("mod ") {
            if next.ends_with('{') && !next.starts_with(' ') {
                break;
            }
            lines.next();
            continue;
        }
        if is_test && next.trim_start().starts_with("use ") {
            while lines.next().is_some_and(|line| !line.ends_with(';')) {}
            continue;
        }
        code.push_str(line);
        code.push('\n');
    }
    code
}

/// The modules that a source declares in files of their own.
fn children(code: &str) -> Vec<String> {
    let declarations = code.lines().filter_map(|line| {
        let line = line.trim_start();
        let line = line.strip_prefix("pub").map_or(line, |rest| {
            let rest = rest
                .strip_prefix('(')
                .map_or(rest, |in_| in_.split_once(')').map_or("", |(_, rest)| rest));
            rest.trim_start()
        });
        line.strip_prefix("mod ")?.strip_suffix(';')
    });
    declarations.map(String::from).collect()
}

/// The imports of a source, and the paths that its code names in full.
fn imports(code: &str) -> Vec<Import> {
    let mut imports = Vec::new();
    let mut rest = code;
    let mut without = String::new();
    while let Some(at) = next_use(rest) {
        let (before, after) = rest.split_at(at);
        let (statement, after) = after.split_once(';').unwrap_or((after, ""));
        without.push_str(before);
        let is_handed_on = statement.trim_start().starts_with("pub");
        let path = statement.split_once("use ").map_or("", |(_, path)| path);
        let paths = expanded(path);
        imports.extend(paths.into_iter().map(|path| Import { path, is_handed_on }));
        rest = after;
    }
    without.push_str(rest);
    for (at, _) in ["crate::", "super::"]
        .iter()
        .flat_map(|start| without.match_indices(start))
    {
        let before = without[..at].chars().next_back();
        let is_part = before.is_some_and(|c| c.is_alphanumeric() || matches!(c, '_' | ':' | '$'));
        // A visibility names no item.
        if is_part || without[..at].ends_with("pub(in ") {
            continue;
        }
        let end = without[at..].find(|c: char| !c.is_alphanumeric() && !matches!(c, '_' | ':'));
        let path = &without[at..end.map_or(without.len(), |end| at + end)];
        imports.push(Import {
            path: path
                .trim_end_matches(':')
                .split("::")
                .map(String::from)
                .collect(),
            is_handed_on: false,
        });
    }
    imports
}

/// The position of the next `use` at the beginning of a line.
fn next_use(code: &str) -> Option<usize> {
    let mut at = 0;
    for line in code.split_inclusive('\n') {
        let start = line.trim_start();
        let is_use = start.starts_with("use ")
            || start.starts_with("pub use ")
            || (start.starts_with("pub(") && start.contains(") use "));
        if is_use {
            return Some(at);
        }
        at += line.len();
    }
    None
}

/// The paths of an import, each name in braces with its own.
fn expanded(path: &str) -> Vec<ModulePath> {
    let path = path.trim();
    let Some((start, list)) = path.split_once('{') else {
        let path = path.split(" as ").next().unwrap_or_default();
        return vec![
            path.split("::")
                .map(|part| part.trim().to_string())
                .collect(),
        ];
    };
    let list = list.trim_end().strip_suffix('}').unwrap_or(list);
    let (mut depth, mut item, mut items) = (0, String::new(), Vec::new());
    for c in list.chars() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if c == ',' && depth == 0 {
            items.push(std::mem::take(&mut item));
        } else {
            item.push(c);
        }
    }
    items.push(item);
    let start = start.trim();
    let named = items.iter().filter(|item| !item.trim().is_empty());
    named
        .flat_map(|item| expanded(&format!("{start}{}", item.trim())))
        .collect()
}

/// The files that each file needs, directly or through others.
fn reached<'a>(edges: &BTreeMap<&'a str, BTreeSet<&'a str>>, from: &'a str) -> BTreeSet<&'a str> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(file) = open.pop() {
        for &next in edges.get(file).into_iter().flatten() {
            if reached.insert(next) {
                open.push(next);
            }
        }
    }
    reached
}

/// The circles of a package: sets of files of which each needs all others.
fn circles(package: &Package) -> BTreeSet<BTreeSet<String>> {
    let edges = package.edges();
    let reached: BTreeMap<_, _> = edges
        .keys()
        .map(|&file| (file, reached(&edges, file)))
        .collect();
    let circles = reached
        .iter()
        .filter(|(file, all)| all.contains(*file))
        .map(|(file, all)| {
            let others = all
                .iter()
                .filter(|other| reached.get(*other).is_some_and(|all| all.contains(file)));
            others.map(ToString::to_string).collect()
        });
    circles.collect()
}

/// Circles that are known, with what ties them. None may be added, and one that is open goes from
/// the list.
const STAY: &[(&[&str], &str)] = &[
    (
        &[
            "crates/mesa-hal-sim/src/board/gateware.rs",
            "crates/mesa-hal-sim/src/board/mod.rs",
            "crates/mesa-hal-sim/src/board/pci.rs",
        ],
        "a PCI board is a board with other carriers of its registers",
    ),
    (
        &[
            "crates/mesa-hal-sim/src/fpga/decode.rs",
            "crates/mesa-hal-sim/src/fpga/fabric.rs",
            "crates/mesa-hal-sim/src/fpga/mod.rs",
            "crates/mesa-hal-sim/src/fpga/plant.rs",
            "crates/mesa-hal-sim/src/fpga/slots.rs",
            "crates/mesa-hal-sim/src/modules/built_in.rs",
            "crates/mesa-hal-sim/src/modules/dpll.rs",
            "crates/mesa-hal-sim/src/modules/encoder.rs",
            "crates/mesa-hal-sim/src/modules/inputs.rs",
            "crates/mesa-hal-sim/src/modules/io_ports.rs",
            "crates/mesa-hal-sim/src/modules/module.rs",
            "crates/mesa-hal-sim/src/modules/outputs.rs",
            "crates/mesa-hal-sim/src/modules/pwm/mod.rs",
            "crates/mesa-hal-sim/src/modules/smart_serial.rs",
            "crates/mesa-hal-sim/src/modules/stepgen/mod.rs",
            "crates/mesa-hal-sim/src/modules/watchdog.rs",
        ],
        "a simulated module works on the fabric, which contains the modules",
    ),
];

#[test]
fn no_files_need_each_other_but_those_that_are_listed() {
    let mut found = BTreeSet::new();
    for root in ROOTS {
        found.extend(circles(&Package::read(root)));
    }
    let listed: BTreeSet<BTreeSet<String>> = STAY
        .iter()
        .map(|(files, _)| files.iter().map(ToString::to_string).collect())
        .collect();
    let new: Vec<_> = found.difference(&listed).collect();
    let gone: Vec<_> = listed.difference(&found).collect();
    assert!(new.is_empty(), "files that need each other: {new:#?}");
    assert!(
        gone.is_empty(),
        "circles that are open now, to be taken from the list: {gone:#?}"
    );
}

#[test]
fn circle_is_found_through_a_module_that_hands_names_on() {
    let module = |path: &str| {
        path.split("::")
            .filter(|p| !p.is_empty())
            .map(String::from)
            .collect::<ModulePath>()
    };
    let mut package = Package::default();
    for (path, code) in [
        ("", "mod a;\nmod b;\npub use b::B;\n"),
        ("a", "use super::B;\nuse std::fmt;\n"),
        ("b", "use crate::{\n    a::{A, C},\n    other::D,\n};\n"),
    ] {
        package.files.insert(module(path), format!("{path}.rs"));
        package
            .imports
            .insert(module(path), imports(&code_of(code)));
    }
    let expected = BTreeSet::from(["a.rs", "b.rs"].map(String::from));
    assert_eq!(circles(&package), BTreeSet::from([expected]));
    let open = code_of("#[cfg(test)]\nmod tests {\n    use crate::a::A;\n}\n");
    assert!(imports(&open).is_empty(), "unit tests may know everything");
}

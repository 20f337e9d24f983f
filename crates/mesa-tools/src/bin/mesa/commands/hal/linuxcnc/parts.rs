//! LinuxCNC's realtime parts that the written files use, and their functions.

use std::fmt::Write;

/// Parts by component: LinuxCNC loads a component once, with the names of all its parts.
#[derive(Debug, Default)]
pub struct Parts {
    components: Vec<Component>,
    /// Functions, in the order in which they run.
    functions: Vec<String>,
}

#[derive(Debug)]
struct Component {
    name: &'static str,
    parts: Vec<String>,
    /// What each part of `logic` is.
    personalities: Vec<String>,
}

impl Parts {
    /// Adds a part, whose function has its name and runs after those that were added before it.
    pub fn add(&mut self, component: &'static str, part: &str) {
        self.component(component).parts.push(part.to_owned());
        self.functions.push(part.to_owned());
    }

    /// Adds a part `logic` with the given number of inputs; `kind` is 0x1 for and, 0x2 for or.
    pub fn add_logic(&mut self, kind: &str, inputs: usize, part: &str) {
        self.add("logic", part);
        let personality = format!("{kind}{inputs:02x}");
        self.component("logic").personalities.push(personality);
    }

    fn component(&mut self, name: &'static str) -> &mut Component {
        let found = self.components.iter().position(|it| it.name == name);
        let at = found.unwrap_or_else(|| {
            self.components.push(Component {
                name,
                parts: Vec::new(),
                personalities: Vec::new(),
            });
            self.components.len() - 1
        });
        &mut self.components[at]
    }

    /// The lines that load them.
    pub fn loads(&self) -> String {
        let mut text = String::new();
        for Component {
            name,
            parts,
            personalities,
        } in &self.components
        {
            let _ = write!(text, "loadrt {name} names={}", parts.join(","));
            if !personalities.is_empty() {
                let _ = write!(text, " personality={}", personalities.join(","));
            }
            text.push('\n');
        }
        text
    }

    /// The lines that add their functions to the thread.
    pub fn functions(&self) -> String {
        let mut text = String::new();
        for name in &self.functions {
            let _ = writeln!(text, "addf {name} servo-thread");
        }
        text
    }
}

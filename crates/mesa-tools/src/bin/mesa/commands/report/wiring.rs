//! The report of a wiring check, as `mesa wiring --report` has written it.

use std::path::Path;

use serde_json::Value;

use super::attachment::{self, written_at};
use super::html::{Html, code, text};
use crate::ui::context::Failure;

/// A report of a wiring check.
#[derive(Debug)]
pub struct WiringReport {
    /// Name of the file, and when it was written.
    source: String,
    content: Content,
}

#[derive(Debug)]
enum Content {
    Text(String),
    Json(Judged),
}

#[derive(Debug)]
struct Judged {
    summary: String,
    /// Terminal and signal, pin, verdict, details.
    rows: Vec<[String; 4]>,
    notes: Vec<String>,
}

impl WiringReport {
    /// Reads a report: JSON, or text as it is.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let text = attachment::read(path)?;
        let content = text.and_then(|text| match serde_json::from_str::<Value>(&text) {
            Ok(report) => Judged::of(&report).map(Content::Json),
            Err(_) => Some(Content::Text(text)).filter(|_| !is_json(path)),
        });
        let content = content.ok_or_else(|| {
            let advice = "give the file of `mesa wiring --report`";
            let what = format_args!("{}: no report of a wiring check; {advice}", path.display());
            Failure::usage(what).advising(advice)
        })?;
        Ok(Self {
            source: written_at(path),
            content,
        })
    }

    /// The section of the page.
    pub fn write(&self, html: &mut Html) {
        html.element("h2", "Wiring check");
        html.element("p", &self.source);
        match &self.content {
            Content::Text(text) => html.element("pre", text),
            Content::Json(report) => {
                html.element("p", &report.summary);
                html.list(&report.notes);
                let columns = [
                    text("Terminal"),
                    code("Pin"),
                    text("Verdict"),
                    text("Details"),
                ];
                html.table(columns, &report.rows);
            }
        }
    }
}

fn is_json(path: &Path) -> bool {
    path.extension().is_some_and(|end| end == "json")
}

impl Judged {
    /// `None` if the value is no report of a wiring check.
    fn of(report: &Value) -> Option<Self> {
        let terminals = report["terminals"].as_array()?;
        let outcome = report["outcome"].as_str()?;
        let ok = terminals
            .iter()
            .filter(|row| row["verdict"] == "ok")
            .count();
        let missing = texts(&report["missing"]);
        let missing = missing.map(|missing| format!("missing, and not checked: {missing}"));
        let pairs = report["exchanged"].as_array().into_iter().flatten();
        let pairs = pairs.map(|pair| {
            let pair: Vec<String> = texts(pair).collect();
            format!("exchanged: {}", pair.join(" and "))
        });
        Some(Self {
            summary: format!(
                "{}: {ok} of {} in order; {outcome}",
                shown(&report["address"]),
                terminals.len()
            ),
            rows: terminals.iter().map(row).collect(),
            notes: missing.chain(pairs).collect(),
        })
    }
}

fn row(terminal: &Value) -> [String; 4] {
    let place = format!(
        "{} {}",
        shown(&terminal["terminal"]),
        shown(&terminal["signal"])
    );
    let verdict = shown(&terminal["verdict"]).replace('_', " ");
    let [before, after] = ["before", "after"].map(|key| shown(&terminal[key]));
    let range = format!("{before} to {after} {}", shown(&terminal["unit"]));
    let range = Some(range.trim_end().to_owned()).filter(|_| !after.is_empty());
    let others = texts(&terminal["others"]).collect::<Vec<_>>().join(", ");
    let others = Some(others).filter(|others| !others.is_empty());
    let others = others.map(|others| format!("also changed: {others}"));
    let said = ["said", "reason"].map(|key| Some(shown(&terminal[key])));
    let details = said.into_iter().chain([range, others]).flatten();
    let details: Vec<String> = details.filter(|detail| !detail.is_empty()).collect();
    [
        place.trim().to_owned(),
        shown(&terminal["pin"]),
        verdict,
        details.join("; "),
    ]
}

/// A value as text, without quotation marks; empty for null.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::Bool(true) => "on".to_owned(),
        Value::Bool(false) => "off".to_owned(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

fn texts(list: &Value) -> impl Iterator<Item = String> {
    list.as_array().into_iter().flatten().map(shown)
}

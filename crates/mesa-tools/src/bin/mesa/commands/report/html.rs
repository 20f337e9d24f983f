//! HTML, element by element; every text is escaped.

use std::fmt::{self, Display, Write};

/// A page, or a part of one. Its elements are well-formed XML as well.
#[derive(Debug, Default)]
pub struct Html(String);

/// A column of a table: its heading, and the class of its cells.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    pub heading: &'static str,
    pub class: Option<&'static str>,
}

/// Column of ordinary text.
pub const fn text(heading: &'static str) -> Column {
    Column {
        heading,
        class: None,
    }
}

/// Column of terminals or signals, of which a cell may have several.
pub const fn place(heading: &'static str) -> Column {
    Column {
        heading,
        class: Some("place"),
    }
}

/// Column of names and numbers as they are typed.
pub const fn code(heading: &'static str) -> Column {
    Column {
        heading,
        class: Some("code"),
    }
}

impl Html {
    /// A whole page in English, with its style.
    pub fn page(title: &str, style: &str, content: &Self) -> String {
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
             <meta name=\"viewport\" content=\"width=device-width\"/>\n<title>{}</title>\n\
             <style>\n{style}</style>\n</head>\n<body>\n{}</body>\n</html>\n",
            Escaped(title),
            content.0
        )
    }

    /// An element with a text.
    pub fn element(&mut self, name: &str, content: impl Display) {
        self.classed(name, None, content);
    }

    /// As [`element`](Self::element), of a class.
    pub fn classed(&mut self, name: &str, class: Option<&str>, content: impl Display) {
        let class = class.map(|class| format!(" class=\"{class}\""));
        let class = class.unwrap_or_default();
        let content = content.to_string();
        self.put(format_args!(
            "<{name}{class}>{}</{name}>\n",
            Escaped(&content)
        ));
    }

    /// A list of texts; nothing if there are none.
    pub fn list(&mut self, items: &[String]) {
        if items.is_empty() {
            return;
        }
        self.put("<ul>\n");
        for item in items {
            self.element("li", item);
        }
        self.put("</ul>\n");
    }

    /// A table of facts: the name of each, and the fact.
    pub fn facts(&mut self, facts: &[(&str, String)]) {
        self.put("<table class=\"facts\">\n<tbody>\n");
        for (name, fact) in facts {
            self.put("<tr>");
            self.element("th", name);
            self.element("td", fact);
            self.put("</tr>\n");
        }
        self.put("</tbody>\n</table>\n");
    }

    /// A table whose heading is repeated on each printed page.
    pub fn table<const N: usize>(&mut self, columns: [Column; N], rows: &[[String; N]]) {
        self.put("<table>\n<thead>\n<tr>");
        for column in columns {
            self.element("th", column.heading);
        }
        self.put("</tr>\n</thead>\n<tbody>\n");
        for row in rows {
            self.put("<tr>");
            for (column, cell) in columns.iter().zip(row) {
                self.classed("td", column.class, cell);
            }
            self.put("</tr>\n");
        }
        self.put("</tbody>\n</table>\n");
    }

    /// A picture, which is part of the page. As an image it runs no script.
    pub fn picture(&mut self, description: &str, svg: &str) {
        let data = svg.bytes().fold(String::new(), |mut data, byte| {
            let _ = match byte {
                b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' => {
                    write!(data, "{}", char::from(byte))
                }
                _ => write!(data, "%{byte:02X}"),
            };
            data
        });
        let description = Escaped(description);
        self.put(format_args!(
            "<img alt=\"{description}\" src=\"data:image/svg+xml,{data}\"/>\n"
        ));
    }

    fn put(&mut self, markup: impl Display) {
        let _ = write!(self.0, "{markup}");
    }
}

/// A text in which no character is markup. Characters that XML does not have are replaced.
struct Escaped<'a>(&'a str);

impl Display for Escaped<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.chars().try_for_each(|character| match character {
            '&' => f.write_str("&amp;"),
            '<' => f.write_str("&lt;"),
            '>' => f.write_str("&gt;"),
            '"' => f.write_str("&quot;"),
            '\'' => f.write_str("&#39;"),
            '\n' | '\t' => f.write_char(character),
            other if other.is_control() || matches!(other, '\u{FFFE}' | '\u{FFFF}') => {
                f.write_char(char::REPLACEMENT_CHARACTER)
            }
            other => f.write_char(other),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_is_markup() {
        let hostile = "<script>alert(\"1\")</script> & 'x' \u{0} \u{1b}";
        let mut html = Html::default();
        html.element("p", hostile);
        html.list(&[hostile.to_owned()]);
        html.facts(&[("fact", hostile.to_owned())]);
        html.table([code("a")], &[[hostile.to_owned()]]);
        html.picture(hostile, hostile);
        let page = Html::page(hostile, "", &html);
        assert!(!page.contains("<script"), "{page}");
        assert_eq!(
            page.matches("&lt;script&gt;alert(&quot;1&quot;)").count(),
            6
        );
        assert!(page.contains("%3Cscript%3E"), "{page}");
        assert!(!page.contains(['\u{0}', '\u{1b}']), "{page}");
    }
}

//! The report as one page that needs nothing else, and its tables for LaTeX.

use super::summaries::ReportTable;
use std::fmt::Write;

const STYLE: &str = include_str!("report.css");

/// A part of the report.
pub(super) enum ReportSection<'a> {
    /// A table.
    Table(&'a ReportTable),
    /// A figure: its name, title, caption and SVG.
    Figure(&'a str, &'a str, &'a str, &'a str),
}

/// What the page says first.
pub(super) struct ReportHeader<'a> {
    pub(super) title: &'a str,
    /// Of what it was made.
    pub(super) data_description: String,
    /// People are simulated: said in every part.
    pub(super) simulated: bool,
    pub(super) notes: &'a [String],
    /// What the statistics presumed.
    pub(super) assumptions: &'a [(String, Vec<String>)],
    pub(super) replays: ReplayLinks<'a>,
}

/// Where a trial is replayed.
#[derive(Clone, Copy)]
pub(super) enum ReplayLinks<'a> {
    /// By a command: a record links to the words on it.
    Command,
    /// By the server of the page, under the place of its record here.
    Served(&'a [String]),
}

fn escape_html(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            _ => out.push(letter),
        }
    }
    out
}

/// The page.
pub(super) fn page(head: &ReportHeader<'_>, parts: &[ReportSection<'_>]) -> String {
    let title = escape_html(head.title);
    let mut out = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n<meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>{title}: report</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n<p>{}</p>\n",
        escape_html(&head.data_description)
    );
    let add = &mut out;
    let simulated = "Simulated participants: no evidence about people.";
    if head.simulated {
        _ = writeln!(add, "<p class=\"simulated\" role=\"note\">{simulated}</p>");
    }
    if !head.notes.is_empty() {
        _ = writeln!(add, "<section class=\"notes\"><h2>What is missing or left out</h2><ul>");
        head.notes.iter().for_each(|note| _ = writeln!(add, "<li>{}</li>", escape_html(note)));
        _ = writeln!(add, "</ul></section>");
    }
    _ = writeln!(add, "<nav aria-label=\"Contents\"><ul>");
    for part in parts {
        let (id, title) = match part {
            ReportSection::Table(table) => (format!("table-{}", table.name), table.title.as_str()),
            ReportSection::Figure(name, title, ..) => (format!("figure-{name}"), *title),
        };
        let kind = if matches!(part, ReportSection::Table(_)) { "table" } else { "figure" };
        _ = writeln!(add, "<li><a href=\"#{id}\">{}</a> <small>{kind}</small></li>", escape_html(title));
    }
    _ = writeln!(add, "</ul></nav>");
    for part in parts {
        match part {
            ReportSection::Table(table) => self::table(add, table, head.replays),
            ReportSection::Figure(name, title, caption, svg) => {
                // One picture with a name, not its marks one by one.
                let named = svg.replacen(
                    "<svg ",
                    &format!("<svg role=\"img\" aria-label=\"{}\" ", escape_html(title)),
                    1,
                );
                let also = if head.simulated { format!(" {simulated}") } else { String::new() };
                _ = writeln!(
                    add,
                    "<figure id=\"figure-{name}\" role=\"group\" aria-label=\"{0}\"><div class=\"scroll\">{named}</div>\
                     <figcaption><strong>{0}.</strong> {1}{also}</figcaption></figure>",
                    escape_html(title),
                    escape_html(caption)
                );
            }
        }
    }
    if !head.assumptions.is_empty() {
        _ = writeln!(add, "<section class=\"notes\"><h2>What the statistics presume</h2>");
        for (measure, notes) in head.assumptions {
            _ = writeln!(add, "<h3>{}</h3><ul>", escape_html(measure));
            notes.iter().for_each(|note| _ = writeln!(add, "<li>{}</li>", escape_html(note)));
            _ = writeln!(add, "</ul>");
        }
        _ = writeln!(add, "</section>");
    }
    out.push_str("</main>\n</body>\n</html>\n");
    out
}

fn table(out: &mut String, table: &ReportTable, replays: ReplayLinks<'_>) {
    let ReportTable { name, title, caption, headers: head, rows } = table;
    _ = writeln!(
        out,
        "<section id=\"table-{name}\"><h2>{}</h2><div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{0}\"><table>\
         <thead><tr>",
        escape_html(title)
    );
    head.iter().for_each(|cell| _ = write!(out, "<th scope=\"col\">{}</th>", escape_html(cell)));
    _ = writeln!(out, "</tr></thead><tbody>");
    for row in rows {
        out.push_str("<tr>");
        for (index, cell) in row.iter().enumerate() {
            let number = cell.starts_with(|c: char| c.is_ascii_digit() || c == '-' || c == '–' || c == '<');
            let class = match cell.chars().count() {
                _ if number => " class=\"number\"",
                ..=12 => " class=\"short\"",
                _ => "",
            };
            let shown = match head[index].as_str() {
                "record" if !cell.is_empty() => record(cell, replays),
                _ => escape_html(cell),
            };
            _ = write!(out, "<td{class}>{shown}</td>");
        }
        out.push_str("</tr>\n");
    }
    _ = writeln!(
        out,
        "</tbody></table></div><p id=\"about-{name}\" class=\"caption\">{}</p></section>",
        escape_html(caption)
    );
}

/// A record, as a link to its replay.
fn record(record: &str, replays: ReplayLinks<'_>) -> String {
    let address = match replays {
        ReplayLinks::Command => Some("#about-trials".to_owned()),
        ReplayLinks::Served(records) => {
            records.iter().position(|other| other == record).map(|number| format!("replay?trial={number}"))
        }
    };
    let words = format!("<code>{}</code>", escape_html(record));
    address.map_or(words.clone(), |address| format!("<a href=\"{address}\">{words}</a>"))
}

/// The table for LaTeX, with rules of the package booktabs.
pub(super) fn latex(table: &ReportTable) -> String {
    let line = |cells: &[String]| {
        format!("{} \\\\\n", cells.iter().map(|cell| escape_latex(cell)).collect::<Vec<_>>().join(" & "))
    };
    let mut out = format!(
        "% \\usepackage{{booktabs}}\n\\begin{{table}}\n\\caption{{{}. {}}}\n\\label{{tab:{}}}\n\\begin{{tabular}}{{{}}}\n\\toprule\n",
        escape_latex(&table.title),
        escape_latex(&table.caption),
        table.name,
        "l".repeat(table.headers.len())
    );
    out.push_str(&line(&table.headers));
    out.push_str("\\midrule\n");
    table.rows.iter().for_each(|row| out.push_str(&line(row)));
    out.push_str("\\bottomrule\n\\end{tabular}\n\\end{table}\n");
    out
}

fn escape_latex(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', letter]),
            '\\' => out.push_str("\\textbackslash{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '^' => out.push_str("\\textasciicircum{}"),
            '<' => out.push_str("$<$"),
            '>' => out.push_str("$>$"),
            '–' => out.push_str("--"),
            _ => out.push(letter),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_people_typed_is_text_in_every_language() {
        let table = ReportTable {
            name: "rankings",
            title: "A & B".to_owned(),
            caption: "50 % of x_1".to_owned(),
            headers: vec!["P".to_owned(), "why".to_owned()],
            rows: vec![vec!["P1".to_owned(), "<script>alert(1)</script> \\input{x}".to_owned()]],
        };
        let head = ReportHeader {
            title: "t<b>",
            data_description: String::new(),
            simulated: true,
            notes: &[],
            assumptions: &[],
            replays: ReplayLinks::Command,
        };
        let page = page(&head, &[ReportSection::Table(&table)]);
        assert!(
            !page.contains("<script>") && page.contains("&lt;script&gt;") && page.contains("t&lt;b&gt;"),
            "{page}"
        );
        assert!(page.contains("no evidence about people"));
        let latex = latex(&table);
        assert!(latex.contains("A \\& B") && latex.contains("50 \\% of x\\_1"), "{latex}");
        assert!(latex.contains("\\textbackslash{}input\\{x\\}"), "{latex}");
    }

    #[test]
    fn a_record_links_to_its_replay_by_its_place_among_the_records() {
        let records = ["t/b".to_owned(), "t/a&b".to_owned()];
        let served = ReplayLinks::Served(&records);
        assert_eq!(record("t/a&b", served), "<a href=\"replay?trial=1\"><code>t/a&amp;b</code></a>");
        assert_eq!(record("gone", served), "<code>gone</code>");
        assert_eq!(record("t/b", ReplayLinks::Command), "<a href=\"#about-trials\"><code>t/b</code></a>");
    }
}

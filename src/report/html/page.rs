//! One page: the frame, styles and scripts around the parts that a run or a sweep shows.

use std::io::{self, Write};
use std::path::Path;
use std::sync::LazyLock;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use quick_xml::escape::escape;

use super::chart::Chart;
use crate::mesh::io::{WriteError, write_atomically};

const STYLE: &str = include_str!("page.css");
const CHARTS: &str = include_str!("charts.js");
const SURFACE: &str = include_str!("surface.js");
const CANVAS: &str = include_str!("canvas.js");
const VIEWER: &str = include_str!("viewer.js");
const SWEEP: &str = include_str!("sweep.js");
const TABLE: &str = include_str!("table.js");
const START: &str = include_str!("start.js");
/// plotly.js with its scatter, bar and pie traces alone, MIT: npm's plotly.js-basic-dist-min, unchanged.
const PLOTLY: &str = include_str!("plotly-basic-3.7.0.min.js");

/// A third of what it takes as it stands.
fn packed_library() -> &'static str {
    static PACKED: LazyLock<String> = LazyLock::new(|| {
        let packed = packed(PLOTLY.bytes(), Compression::default());
        format!("<script type=\"text/plain\" id=\"plotly\">{packed}</script>")
    });
    &PACKED
}

/// Bytes as base64 of zlib, which the script of the page unpacks.
pub(super) fn packed(bytes: impl Iterator<Item = u8>, effort: Compression) -> String {
    let bytes: Vec<u8> = bytes.collect();
    let mut encoder = ZlibEncoder::new(Vec::new(), effort);
    let packed = encoder.write_all(&bytes).and_then(|()| encoder.finish());
    STANDARD.encode(packed.expect("memory takes all that is written"))
}

/// A page in the making.
#[derive(Debug, Default)]
pub(super) struct Page {
    pub(super) title: String,
    /// Heading and HTML of each section.
    pub(super) sections: Vec<(String, String)>,
    pub(super) charts: Vec<Chart>,
    /// Charts that are files, while the page draws its own.
    pub(super) pictures: Vec<Chart>,
    /// JSON for the viewer.
    pub(super) viewer: Option<String>,
    /// JSON for the charts of a sweep.
    pub(super) sweep: Option<String>,
}

/// Text as HTML.
pub(super) fn text(text: &str) -> String {
    escape(text).into_owned()
}

/// A paragraph of text.
pub(super) fn paragraph(words: &str) -> String {
    format!("<p>{}</p>\n", text(words))
}

/// The place of a chart; the script of the page draws it there.
pub(super) fn chart(chart: &Chart) -> String {
    format!(
        "<figure><figcaption>{title}</figcaption><div class=\"chart\" id=\"{id}\" role=\"img\" aria-label=\"{title}\"></div>\
         </figure>\n",
        title = text(&chart.title),
        id = text(&chart.id)
    )
}

/// JSON in an element that no script tag in it can end.
fn data(id: &str, json: &str) -> String {
    format!("<script type=\"application/json\" id=\"{id}\">{}</script>\n", json.replace('<', "\\u003c"))
}

impl Page {
    pub(super) fn write(&self, path: &Path) -> Result<(), WriteError> {
        write_atomically(path, |file| self.put(file))
    }

    pub(super) fn to_html(&self) -> String {
        let mut html = Vec::new();
        self.put(&mut html).expect("memory takes all that is written");
        String::from_utf8(html).expect("a page is made of strings")
    }

    fn put(&self, file: &mut dyn io::Write) -> io::Result<()> {
        writeln!(
            file,
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
                 <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
                 <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; \
                 script-src 'unsafe-inline'; img-src data: blob:\">\n<title>{title}</title>\n\
                 <link rel=\"icon\" href=\"data:,\">\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
                 <header><h1>{title}</h1><button type=\"button\" id=\"theme\">Dark or light</button></header>\n<main>",
            title = text(&self.title)
        )?;
        for (heading, content) in &self.sections {
            writeln!(file, "<section>\n<h2>{}</h2>\n{content}</section>", text(heading))?;
        }
        let charts: Vec<String> = self.charts.iter().map(Chart::for_plotly).collect();
        let names: Vec<String> = self.charts.iter().map(|chart| serde_json::json!(chart.id).to_string()).collect();
        let charts: Vec<String> = names.iter().zip(charts).map(|(name, chart)| format!("{name}:{chart}")).collect();
        writeln!(file, "</main>\n{}", data("charts", &format!("{{{}}}", charts.join(","))))?;
        for (id, json) in [("viewer-data", &self.viewer), ("sweep-data", &self.sweep)] {
            json.iter().try_for_each(|json| writeln!(file, "{}", data(id, json)))?;
        }
        if !self.charts.is_empty() || self.sweep.is_some() {
            // The script of the page unpacks it once its viewer is there.
            writeln!(file, "<!-- plotly.js 3.7.0, MIT, packed by zlib -->\n{}", packed_library())?;
        }
        let scripts = [CHARTS, SWEEP, TABLE, SURFACE, CANVAS, VIEWER, START].join("\n");
        writeln!(file, "<script type=\"module\">\n{scripts}</script>\n</body>\n</html>")
    }

    /// The charts as `plots/ID.svg` in a folder.
    pub(super) fn write_plots(&self, folder: &Path) -> Result<(), WriteError> {
        for chart in self.charts.iter().chain(&self.pictures) {
            let path = folder.join("plots").join(format!("{}.svg", chart.id));
            let picture = super::svg::svg(chart);
            write_atomically(&path, |file| file.write_all(picture.map_err(std::io::Error::other)?.as_bytes()))?;
        }
        Ok(())
    }
}

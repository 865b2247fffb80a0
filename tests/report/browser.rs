//! Pages in a headless browser.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

/// A headless browser.
pub struct Browser(PathBuf);

/// What came of opening a page.
pub struct Seen {
    /// What the probe noted, with `errors` of the page and `ready` and `complete` in milliseconds.
    pub probe: Value,
    /// RGB of the page's top after the probe, row by row, and its width.
    pub pixels: (Vec<[u8; 3]>, usize),
}

/// Runs before all else in the page: keeps what the console would show as an error, and the WebGL contexts.
const KEEP_ERRORS: &str = "<script>window.errors = [];
const keep = (what) => errors.push(String(what));
addEventListener('error', (event) => keep(event.message));
addEventListener('unhandledrejection', (event) => keep(event.reason));
addEventListener('securitypolicyviolation', (event) => keep(`refused: ${event.blockedURI} ${event.violatedDirective}`));
for (const kind of ['error', 'warn']) console[kind] = (...words) => keep(words.join(' '));
window.contexts = new Set();
const getContext = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
  const context = getContext.call(this, kind, ...rest);
  if (kind.startsWith('webgl')) contexts.add(context);
  return context;
};
</script>";

impl Browser {
    pub fn find() -> Option<Self> {
        let named = std::env::var_os("QCBALL_BROWSER").map(PathBuf::from);
        let path = std::env::var_os("PATH").unwrap_or_default();
        let known = ["chromium", "chromium-browser", "google-chrome", "chrome"];
        let on_path = || {
            let mut places = std::env::split_paths(&path).flat_map(|folder| known.map(|name| folder.join(name)));
            places.find(|place| place.is_file())
        };
        let found = named.or_else(on_path).map(Self);
        if found.is_none() {
            assert!(std::env::var_os("QCBALL_BROWSER_REQUIRED").is_none(), "no browser, but one is required");
            println!("skipped: no Chromium on the PATH, and QCBALL_BROWSER names none");
        }
        found
    }

    /// Opens a copy of a page in which `script`, the body of an async function, notes what it sees in `seen`.
    pub fn open(&self, page: &Path, script: &str) -> Seen {
        self.open_at(1400, page, script)
    }

    /// The same in a window so many pixels wide.
    pub fn open_at(&self, width: u32, page: &Path, script: &str) -> Seen {
        let folder = tempfile::tempdir().unwrap();
        let probe = format!(
            "<script type=\"module\">const root = document.documentElement;
            const seen = {{}};
            const pause = () => new Promise((done) => setTimeout(done, 300));
            while (!root.dataset.complete && !errors.length) await pause();
            try {{ {script} }} catch (error) {{ errors.push(String(error)); }}
            seen.errors = errors;
            seen.contexts = contexts.size;
            for (const when of ['ready', 'complete']) seen[when] = Number(root.dataset[when]);
            const note = document.createElement('pre'); note.id = 'probe'; note.hidden = true;
            note.textContent = JSON.stringify(seen); document.body.append(note);
            parent.postMessage(note.outerHTML, '*');</script></body>"
        );
        let text = fs::read_to_string(page).unwrap();
        let (head, tail) = text.split_at(text.rfind("</body>").unwrap());
        let head = head.replacen("<head>", &format!("<head>{KEEP_ERRORS}"), 1);
        let copy = folder.path().join("page.html");
        fs::write(&copy, head + &probe + &tail["</body>".len()..]).unwrap();
        // No window of Chromium is narrower than 500: a frame is.
        let frame = folder.path().join("frame.html");
        let around = format!(
            "<body style=\"margin: 0\"><iframe src=\"page.html\" style=\"border: 0; width: {width}px; height: 1300px\"></iframe>
            <script>addEventListener('message', ({{ data }}) => document.body.insertAdjacentHTML('beforeend', data));</script></body>"
        );
        fs::write(&frame, around).unwrap();
        let opened = if width < 500 { frame } else { copy };
        let picture = folder.path().join("picture.png");
        let output = Command::new(&self.0)
            .args(["--headless", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars"])
            .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .arg(format!("--window-size={width},1300"))
            .args(["--virtual-time-budget=120000", "--dump-dom"])
            .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
            .arg(format!("--screenshot={}", picture.display()))
            .arg(format!("file://{}", opened.display()))
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let page = String::from_utf8_lossy(&output.stdout);
        let noted = page.rsplit_once("<pre id=\"probe\" hidden=\"\">").and_then(|(_, rest)| rest.split_once("</pre>"));
        let noted = noted.unwrap_or_else(|| panic!("no probe: {}", String::from_utf8_lossy(&output.stderr))).0;
        let noted = noted.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        if let Some(keep) = std::env::var_os("QCBALL_KEEP_SCREENSHOTS") {
            let name = format!("{}.png", std::thread::current().name().unwrap_or("page"));
            fs::copy(&picture, Path::new(&keep).join(name)).unwrap();
        }
        Seen { probe: serde_json::from_str(&noted).unwrap(), pixels: pixels(&picture) }
    }
}

fn pixels(picture: &Path) -> (Vec<[u8; 3]>, usize) {
    let file = std::io::BufReader::new(fs::File::open(picture).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let samples = info.color_type.samples();
    (bytes.chunks_exact(samples).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(), info.width as usize)
}

/// Distinct colours, other than greys and near greys, within a rectangle.
pub fn colours(seen: &Seen, rectangle: &Value) -> usize {
    let [left, top, right, bottom] =
        ["left", "top", "right", "bottom"].map(|side| rectangle[side].as_f64().unwrap() as usize);
    let (pixels, width) = &seen.pixels;
    let inside = pixels.chunks_exact(*width).take(bottom).skip(top).flat_map(|row| &row[left..right.min(*width)]);
    let vivid = inside.filter(|pixel| pixel.iter().max().unwrap() - pixel.iter().min().unwrap() > 40);
    vivid.collect::<HashSet<_>>().len()
}

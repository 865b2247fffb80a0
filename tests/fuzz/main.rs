//! Damaged files of every kind: an error or a result, never a panic, a hang or a blow-up.
//!
//! The corpus is the kept files of other programs, the dialects, the configs, and the results folder of a small run. Which
//! input is damaged how follows from the seed and its number alone. The normal run takes half a minute of a processor; more are had by
//!
//! ```text
//! QCBALL_FUZZ_INPUTS=10000000 QCBALL_FUZZ_SEED=1 cargo test --release --test fuzz -- --nocapture
//! QCBALL_FUZZ_FIRST=7766999 QCBALL_FUZZ_INPUTS=1 ...                         # that input again
//! ```

#[allow(dead_code, reason = "of the dialects only the files are of interest here")]
#[path = "../formats/dialects/mod.rs"]
mod dialects;

mod damage;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::Duration;

use damage::{Random, damaged};
use qcball::config::{AnalyticPlan, BenchPlan, SweepPlan};
use qcball::experiment::{self, read_locks};
use qcball::mesh::TetMesh;
use qcball::mesh::io::{SolidFile, read_solid, read_tet_file};
use qcball::report::{write_pages, write_results};
use qcball::solid::{RepairSettings, Surface};
use qcball::{Plan, verify};

/// The longest that an input may take of a processor.
const LONGEST: Duration = Duration::from_secs(10);
/// The most memory that the process may ever have had, in KiB.
const MOST_MEMORY: u64 = 1 << 20;
/// A results folder takes milliseconds to check, another file microseconds: so one input in so many is of a folder.
const FOLDERS: u64 = 1000;

/// A file to be damaged.
struct Seed {
    /// As what it is read: its ending.
    ending: String,
    bytes: Vec<u8>,
}

/// A number from the environment.
fn number(variable: &str, default: u64) -> u64 {
    std::env::var(variable).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{variable} is no number")))
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.is_file());
    files.sort();
    files
}

fn ending(name: &Path) -> String {
    let ending = name.extension().unwrap_or_default().to_str().unwrap().to_lowercase();
    if ending == "gz" { "gii.gz".into() } else { ending }
}

fn corpus() -> Vec<Seed> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let kept = ["tests/formats/data", "configs"].map(|folder| files(&root.join(folder)));
    let kept =
        kept.into_iter().flatten().map(|path| Seed { ending: ending(&path), bytes: std::fs::read(&path).unwrap() });
    let dialects = dialects::all().into_iter().map(|(name, bytes, _)| Seed { ending: ending(Path::new(name)), bytes });
    let locks = Seed { ending: "lock".into(), bytes: b"3 # count\n0 1\n2\n".to_vec() };
    kept.chain(dialects).chain([locks]).collect()
}

/// The results of a small run, with a certificate.
fn results(folder: &Path) {
    let overrides = ["bounds.certify=true", "bounds.certify_time_limit=5"].map(String::from);
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/smoke.toml");
    let plan = Plan::read(&config, &overrides).unwrap();
    let finished = experiment::run(&plan, &mut |_row| {}).unwrap();
    write_results(folder, &finished.report, &finished.record()).unwrap();
}

/// Reads a file in every way that its ending allows, and goes on with what it gives as far as a command would before it
/// computes.
fn read(path: &Path, ending: &str, random: &mut Random) {
    match ending {
        "toml" => {
            let _ = Plan::read(path, &[]);
            let _ = SweepPlan::read(path, &[]);
            let _ = AnalyticPlan::read(path);
            let _ = BenchPlan::read(path);
        }
        "lock" => {
            let _ = read_locks(path, 9);
        }
        _ => match read_solid(path) {
            Ok(SolidFile::Surface(soup)) => {
                let settings = RepairSettings {
                    weld: [None, Some(1e-7), Some(0.01)][random.below(3)],
                    keep_largest: random.below(2) == 0,
                    fill_holes: random.below(2) == 0,
                };
                if let Ok(surface) = Surface::repaired(soup, &settings) {
                    let volume = surface.volume();
                    assert!(volume >= 0.0 || volume.is_nan(), "a surface is turned outward");
                }
            }
            Ok(SolidFile::Tets(soup)) => {
                let soup = soup.tidied();
                let file = read_tet_file(path).expect("it has just been read");
                let count = file.soup.tets.len();
                assert!(file.cell_data.iter().all(|(_, values)| values.len() == count), "a number for each tet");
                let _ = TetMesh::from_either_orientation(soup.points, soup.tets);
            }
            Err(error) => {
                // What it quotes of a file, such as names, may be as long as the file, each byte escaped.
                let (length, size) = (error.to_string().len(), std::fs::metadata(path).map_or(0, |data| data.len()));
                assert!(length as u64 <= 2000 + 10 * size, "a message of {length} bytes for a file of {size}");
            }
        },
    }
}

/// The processor time that this process has had, where the system tells, else that of the clock: a busy machine is no hang.
fn time() -> Duration {
    // https://man7.org/linux/man-pages/man5/proc_pid_stat.5.html: after the name, user and system time are the 12th and the
    // 13th number, in hundredths of a second on every Linux in use.
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let numbers = stat.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
    let ticks: Option<Vec<u64>> = numbers.map(|number| number.parse().ok()).collect();
    match ticks.as_deref() {
        Some(&[user, system]) => Duration::from_millis(10 * (user + system)),
        _ => std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default(),
    }
}

/// The most memory that this process has had, in KiB, where the system tells.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

#[test]
fn damaged_files_never_panic_hang_or_blow_up() {
    let (inputs, seed) = (number("QCBALL_FUZZ_INPUTS", 200_000), number("QCBALL_FUZZ_SEED", 1));
    let first = number("QCBALL_FUZZ_FIRST", 0);
    // In memory where that can be had: a disk would see every input.
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory).unwrap() } else { tempfile::tempdir().unwrap() };
    let whole = folder.path().join("results");
    results(&whole);
    let corpus = corpus();
    let (of_folder, broken) = (files(&whole), folder.path().join("broken"));
    std::fs::create_dir(&broken).unwrap();
    // One of TetGen's pair needs the other.
    for seed in corpus.iter().filter(|seed| ["node", "ele"].contains(&seed.ending.as_str())) {
        std::fs::write(folder.path().join("input").with_extension(&seed.ending), &seed.bytes).unwrap();
    }

    let time_of = |input: u64| {
        let mut random = Random::new(seed, input);
        let started;
        let read_it: &mut dyn FnMut() = if input % FOLDERS == FOLDERS - 1 {
            for path in &of_folder {
                std::fs::copy(path, broken.join(path.file_name().unwrap())).unwrap();
            }
            let path = broken.join(of_folder[random.below(of_folder.len())].file_name().unwrap());
            let bytes = damaged(&std::fs::read(&path).unwrap(), &[], &mut random);
            std::fs::write(&path, bytes).unwrap();
            started = time();
            &mut || {
                let _ = verify::verify(&broken);
                let _ = write_pages(&broken);
            }
        } else {
            let chosen = &corpus[random.below(corpus.len())];
            let other = &corpus[random.below(corpus.len())];
            let path = folder.path().join("input").with_extension(&chosen.ending);
            std::fs::write(&path, damaged(&chosen.bytes, &other.bytes, &mut random)).unwrap();
            started = time();
            let is_one_of_pair = ["node", "ele"].contains(&chosen.ending.as_str());
            &mut move || {
                read(&path, &chosen.ending, &mut random);
                if is_one_of_pair {
                    std::fs::write(&path, &chosen.bytes).unwrap();
                }
            }
        };
        let ended = catch_unwind(AssertUnwindSafe(read_it));
        assert!(ended.is_ok(), "input {input} of seed {seed} panics");
        time().saturating_sub(started)
    };
    let mut longest = Duration::ZERO;
    for input in first..first + inputs {
        let taken = time_of(input);
        longest = longest.max(taken);
        assert!(taken < LONGEST, "input {input} of seed {seed} takes {taken:?}");
    }
    let memory = peak_memory();
    println!(
        "{inputs} inputs of seed {seed}: the longest took {:?} of a processor, the most memory was {memory:?} KiB",
        longest
    );
    assert!(memory.is_none_or(|memory| memory < MOST_MEMORY), "{memory:?} KiB");
}

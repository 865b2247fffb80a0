//! What the system tells of this process.

/// The most memory that was resident at any time, in MiB.
#[cfg(target_os = "linux")]
pub(super) fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = peak.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}

/// Processor seconds of all threads, in user and system mode.
#[cfg(target_os = "linux")]
pub(super) fn cpu_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field is the program's name in parentheses, which may itself hold blanks and parentheses.
    let (_, after_name) = stat.rsplit_once(')')?;
    // Fields 14 and 15 of proc(5), the third being the first after the name.
    let mut ticks = after_name.split_whitespace().skip(11);
    let user: f64 = ticks.next()?.parse().ok()?;
    let system: f64 = ticks.next()?.parse().ok()?;
    Some((user + system) / rustix::param::clock_ticks_per_second() as f64)
}

#[cfg(not(target_os = "linux"))]
pub(super) fn peak_memory_mib() -> Option<f64> {
    None
}

#[cfg(not(target_os = "linux"))]
pub(super) fn cpu_seconds() -> Option<f64> {
    None
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_process_has_used_memory_and_does_use_the_processor() {
        assert!(peak_memory_mib().unwrap() > 0.5);
        let before = cpu_seconds().unwrap();
        let start = std::time::Instant::now();
        while cpu_seconds().unwrap() == before {
            assert!(start.elapsed().as_secs() < 60);
        }
    }
}

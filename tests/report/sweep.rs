//! The page of a sweep.

use std::collections::HashSet;
use std::fs;

use crate::browser::{Browser, colours};
use crate::{qcball, sweep};

#[test]
fn the_table_of_a_sweep_sorts_and_filters_in_a_browser() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let made = sweep(folder.path());
    // A page of each case came with the index, and can be made again.
    let cases: Vec<_> = fs::read_dir(made.join("cases")).unwrap().map(|case| case.unwrap().path()).collect();
    assert_eq!(cases.len(), 6);
    cases.iter().for_each(|case| fs::remove_file(case.join("report.html")).unwrap());
    assert_eq!(qcball(&["report", "--cases", made.to_str().unwrap()]).0, Some(0));
    let page = made.join("report.html");
    let seen = browser.open(
        &page,
        "
        const table = document.getElementById('cases');
        const heads = [...table.tHead.rows[0].cells];
        const column = (name) => heads.findIndex((head) => head.textContent === name);
        const read = (name) => [...table.tBodies[0].rows].filter((row) => !row.hidden).map((row) => row.cells[column(name)].textContent);
        seen.rows = read('case');
        const button = heads[column('max_k')].querySelector('button');
        button.click();
        seen.rising = read('max_k').map(Number);
        seen.sort = heads[column('max_k')].getAttribute('aria-sort');
        button.click();
        seen.falling = read('max_k').map(Number);
        heads[column('domain.solid')].querySelector('button').click();
        seen.names = read('domain.solid');
        const filter = document.getElementById('filter');
        const show = (text) => { filter.value = text; filter.dispatchEvent(new Event('input')); };
        show('cube map.exponent>1');
        seen.filtered = read('domain.solid').concat(read('map.exponent'));
        seen.shown = document.getElementById('shown').textContent;
        // The charts follow.
        const points = () => document.querySelectorAll('#explorer .point').length;
        const heat = () => [...document.querySelectorAll('#heat-table td')].map((cell) => cell.textContent);
        seen.points = [points()];
        seen.heat = [heat()];
        show('');
        seen.points.push(points());
        seen.heat.push(heat());
        seen.along = [...document.querySelectorAll('#along .chart')].map((box) => box.querySelectorAll('.point').length);
        const choose = (id, value) => {
          const control = document.getElementById(id);
          control.value = value;
          control.dispatchEvent(new Event('input'));
        };
        seen.colouredBy = document.getElementById('colour-by').value;
        seen.groups = document.querySelector('#explorer .chart').data.filter((trace) => trace.mode === 'markers').map((trace) => [trace.name, trace.marker.color]);
        seen.links = document.querySelector('#explorer .chart').data.flatMap((trace) => trace.customdata ?? []);
        choose('facet', 'domain.solid');
        seen.facets = [...document.querySelectorAll('#explorer figcaption')].map((one) => one.textContent);
        choose('facet', '');
        choose('x', 'map.exponent');
        choose('y', 'max_k');
        seen.axes = ['xaxis', 'yaxis'].map((axis) => document.querySelector('#explorer .chart').layout[axis].title.text);
        choose('colour-by', 'mean_k');
        choose('colour-by', 'domain.solid');
        choose('x', 'max_k');
        choose('y', 'mean_k');
        // No line of a front rises.
        seen.rises = document.querySelector('#explorer .chart').data.filter((trace) => trace.mode === 'lines').map((trace) => trace.y.some((y, at) => at > 0 && y >= trace.y[at - 1]));
        seen.hrefs = [...document.querySelectorAll('#cases a')].map((one) => one.getAttribute('href'));
        await pause();
        scrollTo(0, 0);
        await pause();
        seen.box = document.querySelector('#explorer .chart').getBoundingClientRect().toJSON();
        ",
    );
    let probe = &seen.probe;
    assert_eq!(probe["errors"], serde_json::json!([]), "{probe}");
    assert_eq!(probe["rows"], serde_json::json!(["1", "2", "3", "4", "5", "6"]));
    let numbers = |name: &str| -> Vec<f64> { serde_json::from_value(probe[name].clone()).unwrap() };
    let (rising, falling) = (numbers("rising"), numbers("falling"));
    assert!(rising.len() == 6 && rising.is_sorted(), "{probe}");
    assert!(falling.iter().rev().eq(&rising), "{probe}");
    assert_eq!(probe["sort"], "ascending");
    let names: Vec<String> = serde_json::from_value(probe["names"].clone()).unwrap();
    assert!(names.is_sorted(), "{probe}");
    assert_eq!(probe["filtered"], serde_json::json!(["cube", "2"]));
    assert_eq!(probe["shown"], "1 of 6 cases");
    // One case, and then six: in the chart, in the heat map of three solids and two exponents, and along both keys.
    assert_eq!(probe["points"], serde_json::json!([1, 6]), "{probe}");
    let filled = |at: usize| probe["heat"][at].as_array().unwrap().iter().filter(|cell| **cell != "").count();
    assert_eq!((filled(0), filled(1), probe["heat"][1].as_array().unwrap().len()), (1, 6, 6), "{probe}");
    // Medians of solids are points, too, since nothing lies between them.
    let along: Vec<u64> = serde_json::from_value(probe["along"].clone()).unwrap();
    assert!(along.len() >= 2 && along[..2] == [6 + 3, 6], "{probe}");
    assert_eq!(probe["colouredBy"], "domain.solid");
    let groups: Vec<(String, String)> = serde_json::from_value(probe["groups"].clone()).unwrap();
    assert_eq!(groups.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["cube", "octahedron", "icosahedron"]);
    assert_eq!(groups.iter().map(|(_, colour)| colour).collect::<HashSet<_>>().len(), 3, "{probe}");
    assert_eq!(probe["facets"].as_array().unwrap().len(), 3, "{probe}");
    assert_eq!(probe["axes"], serde_json::json!(["map.exponent", "max_k"]));
    // A front for each solid.
    assert_eq!(probe["rises"], serde_json::json!([false, false, false]), "{probe}");
    // Links and points open the pages of the cases, which were made.
    for links in ["links", "hrefs"] {
        let links: Vec<String> = serde_json::from_value(probe[links].clone()).unwrap();
        let opens = |link: &String| link.ends_with("/report.html") && made.join(link).is_file();
        assert!(links.len() == 6 && links.iter().all(opens), "{links:?}");
    }
    assert!(colours(&seen, &probe["box"]) > 1, "points and the front have colours of their own");
}

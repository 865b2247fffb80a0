use super::super::tests::{minute, random_star};
use super::super::{Rejection, check};
use super::*;

#[test]
fn a_proof_split_by_a_box_is_whole_or_nothing() {
    let (domain, _, image) = random_star(0);
    let measured = measure(&domain, &image);
    let cancel = minute();
    let mut search = Search { domain: &domain, image: &image, measured: &measured, cancel: cancel.clone(), best: None };
    // A level well below one that is proved without a box.
    let places = search.places();
    let split = |free: Vec<VertexId>| {
        let free = search.grown(free, 3);
        search.best = None;
        search.lifted(&free, &cancel);
        let level = 0.8 * search.best_log();
        Some((search.split(&free, free[0], level).filter(|_| level > 0.0)?, level))
    };
    // At some place the multipliers are a proof for the box only.
    let needed =
        |(good, _): &(Certificate, f64)| check(&Certificate { split: None, ..good.clone() }, &domain, &image).is_err();
    let (good, level) = places.into_iter().filter_map(split).find(needed).unwrap();
    assert_eq!(check(&good, &domain, &image), Ok(level.exp()));
    let read: Certificate = serde_json::from_str(&good.to_json()).unwrap();
    assert_eq!(read, good);

    let rejected = |change: &dyn Fn(&mut Certificate, &mut Split)| {
        let mut bad = good.clone();
        let mut split = bad.split.take().unwrap();
        change(&mut bad, &mut split);
        bad.split = Some(split);
        check(&bad, &domain, &image).expect_err("a tampered certificate")
    };
    let malformed = |change: &dyn Fn(&mut Certificate, &mut Split)| {
        assert!(matches!(rejected(change), Rejection::Malformed(_)));
    };
    malformed(&|_, split| split.outside.truncate(5));
    malformed(&|_, split| split.outside[2].push = -split.outside[2].push);
    malformed(&|_, split| split.outside[2].push = f64::NAN);
    malformed(&|_, split| split.outside[3].certificate.level = 1.0);
    malformed(&|_, split| split.high[1] = split.low[1]);
    malformed(&|_, split| split.low[0] = f64::NEG_INFINITY);
    malformed(&|_, split| split.vertex = domain.boundary().triangles()[0][0].0);
    malformed(&|_, split| split.vertex = u32::MAX);
    malformed(&|_, split| split.outside[0].certificate.split = Some(Box::new(split.clone())));
    let condition = rejected(&|bad, _| bad.level *= 1.001);
    assert!(matches!(condition, Rejection::TraceCondition { .. }), "{condition}");
    let condition = rejected(&|bad, _| bad.lower.iter_mut().flatten().for_each(|entry| *entry *= 0.9));
    assert!(matches!(condition, Rejection::TraceCondition { .. }), "{condition}");
    let condition = rejected(&|_, split| split.outside[5].certificate.level *= 1.001);
    assert!(matches!(condition, Rejection::TraceCondition { .. }), "{condition}");
    // Far from where the vertex can be, the walls leave everything to be proved by the proof for the box, and nothing was.
    let far = rejected(&|_, split| split.low.iter_mut().chain(&mut split.high).for_each(|entry| *entry += 1e3));
    assert!(matches!(far, Rejection::NotNegative | Rejection::NotConcave), "{far}");
}

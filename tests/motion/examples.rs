//! The examples run and say what they promise.

#[path = "../../examples/author_and_roll_out.rs"]
#[allow(unreachable_pub)]
mod author_and_roll_out;

#[path = "../../examples/compare_policies.rs"]
#[allow(unreachable_pub)]
mod compare_policies;

#[test]
fn author_and_roll_out_reaches_its_goals() {
    let precision = author_and_roll_out::roll_out().unwrap();
    assert!(precision.precision.unwrap() < 0.01, "{precision:?}");
    assert_eq!(precision.holds.len(), 2);
    author_and_roll_out::main();
}

#[test]
fn compare_policies_finds_the_model_ahead_when_it_is_right() {
    let rows = compare_policies::compare("ur5e/front_back").unwrap();
    let (nominal, other) = (&rows[0], &rows[1]);
    assert!(nominal.1[1] < nominal.1[0], "{rows:?}");
    assert!(other.1[1] > nominal.1[1], "{rows:?}");
    compare_policies::main();
}

//! The table of what rendering costs, on a small picture: every part of it is there. Times are not judged.
#![allow(clippy::unwrap_used)]

use rigd::study::bench::rendering::{heading, run};

#[test]
fn the_table_has_every_part() {
    let mut lines = Vec::new();
    run((48, 32), 1, &mut |cost| {
        lines.push(cost.line());
        Ok(())
    })
    .unwrap();
    println!("{}\n{}", heading((48, 32)), lines.join("\n"));
    let parts = ["tree over 70000 triangles", "picture, one thread", "all threads together", "radiance, wall"];
    for part in parts {
        assert_eq!(lines.iter().filter(|line| line.contains(part)).count(), 1, "{part}");
    }
}

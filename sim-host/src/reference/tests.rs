use super::examples::{complete, five_agents, narrow_path, path, ring, star};
use super::*;

fn times(end: f64, rows: usize) -> Vec<f64> {
    (0..=rows).map(|k| end * k as f64 / rows as f64).collect()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn dump(name: &str, s: &ReferenceSolution) {
    let mut text = String::new();
    for k in 0..s.times.len() {
        text += &format!("{:?}", s.times[k]);
        for v in s.row(&s.x, k) {
            text += &format!(" {v:?}");
        }
        text.push('\n');
    }
    std::fs::write(format!("/tmp/wt/{name}.txt"), text).unwrap();
}

#[test]
fn report() {
    for end in [2.0, 0.02] {
        for (name, edges) in
            [("ring", ring(5)), ("path", path(5)), ("star", star(5)), ("complete", complete(5))]
        {
            let problem = five_agents(edges, end);
            let at = times(20.0, 2000);
            let run = |tolerance| {
                let start = std::time::Instant::now();
                let s = solve(&problem, &at, &ReferenceOptions { tolerance, ..Default::default() }).unwrap();
                (s, start.elapsed().as_secs_f64())
            };
            let fine = run(1e-11).0;
            for tol in [1e-9, 5e-10] {
                let (s, wall) = run(tol);
                println!(
                    "{name} {end} tol {tol:e}: steps {} ratio {} defect {:e} vs 1e-11 (steps {}) {:e}  wall {wall:.3}",
                    s.steps,
                    s.max_ratio,
                    s.max_defect,
                    fine.steps,
                    distance(&s.x, &fine.x)
                );
                if tol == 1e-9 {
                    dump(&format!("{name}{end}"), &s);
                }
            }
        }
    }
    let problem = narrow_path();
    let at = times(30.0, 3000);
    for tolerance in [1e-11, 1e-10, 1e-9, 1e-8] {
        let start = std::time::Instant::now();
        match solve(&problem, &at, &ReferenceOptions { tolerance, ..Default::default() }) {
            Ok(s) => {
                println!(
                    "narrow {tolerance:e} steps {} ratio {} defect {:e} last x {:?} psi {:e} wall {:?}",
                    s.steps,
                    s.max_ratio,
                    s.max_defect,
                    s.row(&s.x, 3000),
                    s.psi.last().unwrap(),
                    start.elapsed()
                );
                if tolerance == 1e-9 {
                    dump("narrow", &s)
                }
            }
            Err(e) => println!("narrow {tolerance:e} {e}"),
        }
    }
    for end in [40.0, 100.0, 300.0, 600.0, 690.0, 800.0] {
        let start = std::time::Instant::now();
        match solve(&problem, &times(end, 3000), &Default::default()) {
            Ok(s) => println!(
                "{end} steps {} ratio {} defect {:e} u {:?} psi {:e} wall {:?}",
                s.steps,
                s.max_ratio,
                s.max_defect,
                s.row(&s.u, 3000),
                s.psi.last().unwrap(),
                start.elapsed()
            ),
            Err(e) => println!("{end} {e} {:?}", start.elapsed()),
        }
    }
    let mut problem = narrow_path();
    for scale in [100.0, 10.0, 1.0] {
        problem.gains = vec![Gain::Logarithmic { scale }; 11];
        let start = std::time::Instant::now();
        match solve(&problem, &times(30.0, 3000), &Default::default()) {
            Ok(s) => println!(
                "log {scale} steps {} ratio {} defect {:e} u {:?} psi {:e} wall {:?}",
                s.steps,
                s.max_ratio,
                s.max_defect,
                s.row(&s.u, 3000),
                s.psi.last().unwrap(),
                start.elapsed()
            ),
            Err(e) => println!("log {scale} {e} {:?}", start.elapsed()),
        }
    }
}

fn many(nodes: usize, end: f64) -> ReferenceProblem {
    let five = five_agents(ring(5), end);
    let mut edges = ring(nodes);
    edges.extend((0..nodes).map(|i| (i, (i + 7) % nodes, 1.0)));
    let field = |i: usize| {
        let mut f = five.fields[i % 5].clone();
        f.sines[1].phase += i as f64;
        f.sines[2].phase += 1.7 * i as f64;
        f
    };
    ReferenceProblem {
        x0: (0..nodes).map(|i| five.x0[i % 5]).collect(),
        edges,
        fields: (0..nodes).map(field).collect(),
        gains: vec![five.gains[0]; nodes],
        funnels: vec![five.funnels[0]; nodes],
    }
}

#[test]
fn size() {
    for (n, rows, end, tolerance) in
        [(127usize, 20000usize, 20.0, 1e-9), (127, 20000, 20.0, 1e-7), (1000, 50, 2.0, 1e-6)]
    {
        let start = std::time::Instant::now();
        match solve(&many(n, 2.0), &times(end, rows), &ReferenceOptions { tolerance, ..Default::default() }) {
            Ok(s) => println!(
                "{n} {tolerance:e} steps {} ratio {} defect {:e} wall {:?}",
                s.steps,
                s.max_ratio,
                s.max_defect,
                start.elapsed()
            ),
            Err(e) => println!("{n} {e} {:?}", start.elapsed()),
        }
    }
}

//! Expressions against an interpreter of their own, which walks the tree in f64.

use super::syntax::{Binary, Function, Kind, Term};
use super::*;
use funnelnet_law::field::{Field, PreparedField, VectorField};
use funnelnet_law::math;
use proptest::prelude::*;

fn one(text: &str) -> Result<Expression, ExpressionError> {
    Expression::new(&[text], [].into()).map_err(|(_, error)| error)
}

fn value(text: &str, t: f64, x: f64) -> f64 {
    one(text).unwrap().component(0, t, &[x])
}

fn mistake(text: &str) -> String {
    one(text).unwrap_err().to_string()
}

#[test]
fn the_grammar_binds_as_it_says() {
    for (text, expected) in [
        ("-x^2", -9.0),
        ("(-x)^2", 9.0),
        ("(-x)^3", -27.0),
        ("2^3^2", 512.0),
        ("2^-1", 0.5),
        ("x^-2", 1.0 / 9.0),
        ("x^0", 1.0),
        ("x^1", 3.0),
        ("x^7", 2187.0),
        ("(-x)^13", -1_594_323.0),
        ("1 - 2 - 3", -4.0),
        ("12 / x / 2", 2.0),
        ("2 + x*4", 14.0),
        ("-x*2", -6.0),
        ("--x", 3.0),
        ("2*-x", -6.0),
        ("1.5e1 + .5 + 2.", 17.5),
        ("clamp(x, -1, 2) + min(x, 1) + max(x, 7)", 10.0),
        ("abs(-x) + sign(-x) + step(x) + step(0) + step(-x)", 4.0),
        ("sqrt(x*x*x*x) + pow(2, x)", 17.0),
        ("ln(exp(x))", 3.0),
        ("t - x", 2.0),
        ("t^2", 25.0),
        ("2*t + 1", 11.0),
    ] {
        assert!((value(text, 5.0, 3.0) - expected).abs() < 1e-12, "{text}");
    }
    assert!(
        (value("sin(0.5*t) + cos(2*t - 1) + tan(0.1*t)", 5.0, 0.0)
            - (math::sin(2.5) + math::cos(9.0) + math::sin(0.5) / math::cos(0.5)))
        .abs()
            < 1e-12
    );
    assert!((value("tanh(x) + sin(pi*x/6) + x^0.5 + 2^x", 0.0, 3.0) - 11.727_105_561_255_608).abs() < 1e-9);
}

#[test]
fn even_turning_is_a_sinusoid_of_its_own_and_equal_ones_are_one() {
    let waves =
        |text| one(text).unwrap().waves.iter().map(|wave| (wave.frequency, wave.phase)).collect::<Vec<_>>();
    assert_eq!(waves("-x + 2*sin(0.5*t) + sin(t/2)"), [(0.5, 0.0)]);
    assert_eq!(waves("x*sin(3 - (t + 1)*2)"), [(-2.0, 1.0)]);
    assert_eq!(waves("cos(t)"), [(1.0, std::f64::consts::FRAC_PI_2)]);
    assert_eq!(waves("sin(t*t) + sin(x + t) + sin(2)"), []);
    let longest: String = (1..=9).map(|w| format!("+sin({w}*t)")).collect();
    assert!(mistake(&format!("x{longest}")).starts_with("column 75: a node takes at most 8 different sines"));
}

#[test]
fn a_mistake_is_where_it_is() {
    let known = "known: x, t, pi; functions abs min max clamp sin cos tan exp ln sqrt tanh pow sign step";
    for (text, message) in [
        ("", "column 1: expected a number, a name, - or (, found the end"),
        ("-x + ", "column 6: expected a number, a name, - or (, found the end"),
        ("-x + foo(x)", &format!("column 6: nothing is called 'foo'; {known}")),
        ("sim(x)", &format!("column 1: nothing is called 'sim'; {known}; did you mean 'sin'?")),
        ("2x", "column 2: expected an operator (+ - * / ^) or the end, found the name 'x'"),
        ("(x + 1", "column 7: expected an operator or the ) of the ( in column 1, found the end"),
        ("x)", "column 2: this ) closes nothing"),
        ("x + * 2", "column 5: expected a number, a name, - or (, found '*'"),
        ("sin x", "column 5: expected ( after sin, found the name 'x'"),
        ("sin()", "column 5: expected a number, a name, - or (, found ')'"),
        ("max(x)", "column 1: max takes 2 arguments; here are 1"),
        ("x(2)", "column 2: x is no function; write x*( to multiply"),
        ("x1", &format!("column 1: nothing is called 'x1'; {known}")),
        (
            "x % 2",
            "column 3: '%' means nothing here; operators are + - * / ^, arguments are in ( ) and separated by ,",
        ),
        ("1.2.3", "column 4: expected an operator (+ - * / ^) or the end, found the number 0.3"),
        (".", "column 1: '.' is no number"),
        ("é + 1e", "column 1: nothing is called 'é'; known"),
        ("x + 1/0", "column 6: comes to inf: a number must be finite in single precision"),
        ("x + 1e39", "column 5: comes to 1"),
        (
            "sin(1e7*t)",
            "column 1: turns by 10000000 rad/s from 0 rad: allowed are 1000000 rad/s and 1000000 rad",
        ),
    ] {
        assert!(mistake(text).starts_with(message), "{text}: {}", mistake(text));
    }
    let deep = "(".repeat(70) + "x" + &")".repeat(70);
    assert!(mistake(&deep).starts_with("column 65: more than 64 brackets"));
    assert!(mistake(&"x+".repeat(1_500)).starts_with("column 1: is longer than 2000 characters"));
}

#[test]
fn a_program_that_does_not_fit_is_told_what_would() {
    let long = vec!["x*x"; 20].join("+");
    assert_eq!(
        mistake(&long),
        "column 1: comes to 79 operations over all components, the most of them here; a node takes at most 64"
    );
    let deep = (0..9).rev().fold("x".to_owned(), |inner, k| format!("x+{k}*({inner})"));
    assert!(mistake(&deep).contains("more than the 16 values that a node keeps"), "{}", mistake(&deep));
    let many: String = (2..40).map(|k| format!("+{k}")).collect();
    assert!(one(&format!("x{many}")).unwrap_err().message.contains("at most 32 different numbers"));
    let (index, error) = Expression::new(&["x2", &long], [].into()).unwrap_err();
    assert_eq!(index, 1);
    assert!(error.message.contains("nothing is called 'x'; known: x1, x2, t"));
}

#[test]
fn vectors_and_inputs_have_names() {
    let load = Series::new("load", vec![(0.0, 1.0), (10.0, 2.0)]);
    let inputs: Arc<[Series]> = [load].into();
    let field = Expression::new(&["x2", "-x1 - 0.1*x2 + cos(t) + load"], inputs.clone()).unwrap();
    let x = [3.0, 5.0];
    assert_eq!(field.component(0, 0.0, &x), 5.0);
    assert!((field.component(1, 5.0, &x) - (-3.5 + math::cos(5.0) + 1.5)).abs() < 1e-12);
    let slopes = [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[row, column]| field.slope_of(row, column, 5.0, &x));
    assert_eq!(slopes, [0.0, 1.0, -1.0, -0.1]);
    assert!((field.rate_of(1, 5.0, &x) - (0.1 - math::sin(5.0))).abs() < 1e-12);
    let unknown = Expression::new(&["x3", "x1"], inputs).unwrap_err();
    assert!(unknown.1.message.starts_with("nothing is called 'x3'; known: x1, x2, t, pi, load (an input)"));
}

#[test]
fn the_steepest_slope_is_looked_for() {
    let of = |text| one(text).unwrap().explored(4.0, 10.0).steepness();
    assert!((of("-3*x + sin(t)") - 3.0).abs() < 1e-12);
    assert!((40.0..=48.0).contains(&of("x - x^3")), "{}", of("x - x^3"));
}

/// What the text says, by its tree and not by a program.
fn walk<F: Real>(term: &Term, t: F, x: F) -> F {
    // The compiler knows it in f64.
    if let Some(value) = compile::constant(term) {
        return F::from_f64(value);
    }
    let of = |term: &Term| walk(term, t, x);
    match &term.kind {
        Kind::Number(number) => F::from_f64(*number),
        Kind::Time => t,
        Kind::State(_) | Kind::Input(_) => x,
        Kind::Negate(inner) => -of(inner),
        Kind::Binary(Binary::Power, base, exponent) => power(of(base), exponent, of(exponent)),
        Kind::Binary(operator, left, right) => {
            let (a, b) = (of(left), of(right));
            match operator {
                Binary::Add => a + b,
                Binary::Subtract => a - b,
                Binary::Multiply => a * b,
                Binary::Divide | Binary::Power => a / b,
            }
        }
        Kind::Call(Function::Pow, all) => power(of(&all[0]), &all[1], of(&all[1])),
        Kind::Call(function, all) => called(*function, &all.iter().map(of).collect::<Vec<_>>()),
    }
}

fn power<F: Real>(base: F, exponent: &Term, value: F) -> F {
    match compile::constant(exponent).filter(|n| n.fract() == 0.0 && n.abs() <= 64.0) {
        Some(0.0) => F::ONE,
        Some(n) if n > 0.0 => multiplied(base, n as u32),
        Some(n) => F::ONE / multiplied(base, -n as u32),
        None => base.pow(value),
    }
}

fn multiplied<F: Real>(x: F, n: u32) -> F {
    match n {
        1 => x,
        n if n % 2 == 0 => multiplied(x * x, n / 2),
        n => x * multiplied(x, n - 1),
    }
}

fn called<F: Real>(function: Function, all: &[F]) -> F {
    let lower = |a: F, b: F| {
        if a < b {
            a
        } else if a >= b {
            b
        } else {
            a + b
        }
    };
    let higher = |a: F, b: F| -lower(-a, -b);
    let a = all[0];
    match function {
        Function::Abs => a.abs(),
        Function::Min => lower(a, all[1]),
        Function::Max => higher(a, all[1]),
        Function::Clamp => lower(higher(a, all[1]), all[2]),
        Function::Sin => a.sin(),
        Function::Cos => a.cos(),
        Function::Tan => a.tan(),
        Function::Exp => a.exp(),
        Function::Ln => a.ln(),
        Function::Sqrt => a.sqrt(),
        Function::Tanh => a.tanh(),
        Function::Pow => a.pow(all[1]),
        Function::Sign if a > F::ZERO => F::ONE,
        Function::Sign if a < F::ZERO => -F::ONE,
        Function::Sign => a * F::ZERO,
        Function::Step if a >= F::ZERO => F::ONE,
        Function::Step if a < F::ZERO => F::ZERO,
        Function::Step => a,
    }
}

/// The text of a tree, with no brackets but those that it needs.
fn written(term: &Term) -> String {
    let within = |term: &Term, least: u8| match strength(term) < least {
        true => format!("({})", written(term)),
        false => written(term),
    };
    match &term.kind {
        Kind::Number(number) => format!("{number}"),
        Kind::Time => "t".to_owned(),
        Kind::State(_) => "x".to_owned(),
        Kind::Input(_) => "load".to_owned(),
        Kind::Negate(inner) => format!("-{}", within(inner, 3)),
        Kind::Binary(operator, left, right) => {
            let (sign, least_left, least_right) = match operator {
                Binary::Add => ("+", 1, 2),
                Binary::Subtract => ("-", 1, 2),
                Binary::Multiply => ("*", 2, 3),
                Binary::Divide => ("/", 2, 3),
                Binary::Power => ("^", 5, 3),
            };
            format!("{} {sign} {}", within(left, least_left), within(right, least_right))
        }
        Kind::Call(function, arguments) => {
            let name = syntax::FUNCTIONS.iter().find(|entry| entry.1 == *function).unwrap().0;
            format!("{name}({})", arguments.iter().map(written).collect::<Vec<_>>().join(", "))
        }
    }
}

fn strength(term: &Term) -> u8 {
    match &term.kind {
        Kind::Binary(Binary::Add | Binary::Subtract, ..) => 1,
        Kind::Binary(Binary::Multiply | Binary::Divide, ..) => 2,
        Kind::Negate(_) => 3,
        Kind::Binary(Binary::Power, ..) => 4,
        _ => 5,
    }
}

/// Trees whose places are all zero.
fn term() -> impl Strategy<Value = Term> {
    let of = |kind| Term { at: 0, kind };
    let leaf = prop_oneof![
        (0..200_u32).prop_map(move |n| of(Kind::Number(f64::from(n) / 16.0))),
        Just(of(Kind::Time)),
        Just(of(Kind::State(0))),
        Just(of(Kind::State(0))),
    ];
    leaf.prop_recursive(4, 14, 3, move |inner| {
        let two = (inner.clone(), inner.clone());
        let operator = prop_oneof![
            Just(Binary::Add),
            Just(Binary::Subtract),
            Just(Binary::Multiply),
            Just(Binary::Divide)
        ];
        let function = (0..syntax::FUNCTIONS.len()).prop_map(|index| syntax::FUNCTIONS[index]);
        prop_oneof![
            (operator, two.0, two.1).prop_map(move |(operator, a, b)| of(Kind::Binary(
                operator,
                Box::new(a),
                Box::new(b)
            ))),
            (inner.clone(), 0..5_u32).prop_map(move |(base, n)| {
                let exponent = of(Kind::Number(f64::from(n)));
                of(Kind::Binary(Binary::Power, Box::new(base), Box::new(exponent)))
            }),
            inner.clone().prop_map(move |a| of(Kind::Negate(Box::new(a)))),
            (function, [inner.clone(), inner.clone(), inner])
                .prop_map(move |((_, function, count), all)| of(Kind::Call(function, all[..count].to_vec()))),
        ]
    })
}

/// The same with all places zero.
fn placeless(term: &Term) -> Term {
    let kind = match &term.kind {
        Kind::Negate(inner) => Kind::Negate(Box::new(placeless(inner))),
        Kind::Binary(operator, a, b) => {
            Kind::Binary(*operator, Box::new(placeless(a)), Box::new(placeless(b)))
        }
        Kind::Call(function, all) => Kind::Call(*function, all.iter().map(placeless).collect()),
        other => other.clone(),
    };
    Term { at: 0, kind }
}

proptest! {
    #[test]
    fn what_is_written_of_a_tree_reads_as_that_tree(term in term()) {
        let text = written(&term);
        let names = Names { components: 1, inputs: &[] };
        prop_assert_eq!(placeless(&parse::parse(&text, names).unwrap()), term, "{}", text);
    }

    #[test]
    fn any_text_is_read_or_refused_within_it(text in "[-+*/^(),.0-9a-z x]{0,40}") {
        if let Err(error) = one(&text) {
            prop_assert!((1..=text.chars().count() + 1).contains(&error.column), "{}: {}", text, error);
        }
    }

    #[test]
    fn the_program_gives_what_the_tree_says_to_the_bit(term in term(), k in 0..20_000_u64, x in -3.0..3.0_f32) {
        let text = written(&term);
        // A sinusoid goes by its phase and not by its angle: its own test.
        let Ok(field) = one(&text) else { return Ok(()) };
        if !field.waves.is_empty() {
            return Ok(());
        }
        let program = Program {
            code: field.program.code.clone(),
            constants: field.program.constants.iter().map(|&value| value as f32).collect(),
        };
        let node = PreparedField::<f32>::new(&Field::scalar(0.0, 0.0, []), &program, 1e-3);
        let t = k as f64 * 5e-4;
        let (found, expected) = (node.at(k, x), walk(&term, t as f32, x));
        prop_assert!(found == expected || (found.is_nan() && expected.is_nan()), "{}: {} {}", text, found, expected);
        let (found, expected) = (field.component(0, t, &[x.into()]), walk(&term, t, f64::from(x)));
        prop_assert!(found == expected || (found.is_nan() && expected.is_nan()), "{}: {} {}", text, found, expected);
    }

    #[test]
    fn slopes_are_those_of_differences(term in term(), t in 0.0..5.0, x in -3.0..3.0) {
        let text = written(&term);
        let Ok(field) = one(&text) else { return Ok(()) };
        let at = |by: f64| field.component(0, t, &[x + by]);
        let (h, slope) = (1e-5, field.slope_of(0, 0, t, &[x]));
        let by_difference = (at(h) - at(-h)) / (2.0 * h);
        let bend = (at(h) - 2.0 * at(0.0) + at(-h)) / (h * h);
        // Where it is smooth and not huge.
        if bend.abs() < 1e2 && by_difference.abs() < 1e3 && at(0.0).abs() < 1e3 {
            prop_assert!((slope - by_difference).abs() < 2e-3 * (1.0 + slope.abs()), "{}: {} {}", text, slope, by_difference);
        }
    }
}

#[test]
fn functions_fold_as_they_run() {
    // What is constant is computed by the compiler, everything else by the machine: the same, each function.
    for (name, function, count) in syntax::FUNCTIONS {
        let arguments = [0.3, 1.7, 2.5];
        let of = |names: &[&str]| format!("{name}({})", names[..count].join(", "));
        let folded = one(&of(&["0.3", "1.7", "2.5"])).unwrap();
        let run = one(&of(&["x", "(x*0 + 1.7)", "(x*0 + 2.5)"])).unwrap();
        let expected = function.of(&arguments[..count]);
        assert!((folded.component(0, 0.0, &[0.3]) - expected).abs() < 1e-15, "{name}");
        assert!((run.component(0, 0.0, &[0.3]) - expected).abs() < 1e-12, "{name}");
    }
    assert_eq!(Function::Step.of(&[0.0]), 1.0);
}

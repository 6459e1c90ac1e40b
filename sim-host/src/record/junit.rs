//! The expectations of a run as a JUnit report, for CI servers.

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use super::summary::{EventSummary, Expectation, FunnelSummary, Summary};
use crate::exit::Exit;
use crate::printable::{printable, printable_lines};

/// The text of a JUnit file: one suite, named after the scenario, with a test case for each expectation, for
/// each check that every run has to pass, and for the breaches. A failure carries `repeat`, the command that
/// repeats the run.
pub fn junit(summary: &Summary, repeat: &str) -> String {
    let mut suite = TestSuite::new(printable(&summary.scenario));
    suite.set_time(std::time::Duration::try_from_secs_f64(summary.wall_s).unwrap_or_default());
    for expectation in &summary.expect {
        suite.add_test_case(case(&expectation.name, status(expectation, summary, repeat), summary));
    }
    if let Some(expected) = summary.expect.iter().find(|expected| expected.name == RECOVERED) {
        for (at, event) in summary.events.iter().enumerate() {
            let status = recovered(event, expected, summary, repeat);
            suite.add_test_case(case(&format!("event-{}", at + 1), status, summary));
        }
    }
    for check in &summary.checks {
        let status = if check.pass {
            TestCaseStatus::success()
        } else {
            failure(&check.text, "check", summary, repeat)
        };
        suite.add_test_case(case(check.name, status, summary));
    }
    if let Some(funnel) = &summary.funnel {
        suite.add_test_case(case("breaches", breaches(funnel, summary, repeat), summary));
    }
    text(suite)
}

/// A run that came to no verdict.
#[derive(Clone, Copy, Debug)]
pub struct JunitError<'a> {
    /// The scenario as the user named it.
    pub scenario: &'a str,
    /// What happened.
    pub message: &'a str,
    /// How the program ends for it.
    pub exit: Exit,
    /// The command that was run.
    pub command: &'a str,
}

/// The text of a JUnit file for such a run: one test case, `run`, with the error.
pub fn junit_error(error: &JunitError<'_>) -> String {
    let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
    let message = printable_lines(error.message);
    status.set_message(message.lines().next().unwrap_or_default());
    status.set_type(error.exit.kind());
    status.set_description(format!("{message}\ncommand: {}", printable(error.command)));
    let mut case = TestCase::new("run", status);
    case.set_classname("sim-host");
    let mut suite = TestSuite::new(printable(error.scenario));
    suite.add_test_case(case);
    text(suite)
}

fn text(suite: TestSuite) -> String {
    let mut report = Report::new("sim-host");
    report.add_test_suite(suite);
    // Writing into memory fails only on a time stamp that cannot be formatted, and the report has none.
    report.to_string().unwrap_or_default()
}

fn status(expectation: &Expectation, summary: &Summary, repeat: &str) -> TestCaseStatus {
    if expectation.pass {
        return TestCaseStatus::success();
    }
    let Expectation { name, limit, value, .. } = expectation;
    let message = match value {
        Some(value) => format!("{name} is {value:?}, allowed is below {limit:?}"),
        None => format!("{name} could not be measured, allowed is below {limit:?}"),
    };
    failure(&message, "expectation", summary, repeat)
}

/// The expectation of the recovery from each event.
const RECOVERED: &str = "recovered_within";

/// An event from which the network has not recovered in time fails, where the expectation does: only then has the time of an event that a later
/// one cuts short run out.
fn recovered(
    event: &EventSummary,
    expected: &Expectation,
    summary: &Summary,
    repeat: &str,
) -> TestCaseStatus {
    let what = format!("{} s, {}", event.from_s, event.event);
    let limit = expected.limit;
    let (is_late, message) = match (event.recovered_s, event.recovery) {
        (Some(took), _) => {
            (took >= limit, format!("inside {took:?} s after its end, allowed is below {limit:?}"))
        }
        (None, "outside") => (true, "not inside again before the next event, or the end".to_owned()),
        (None, _) => (false, "no tick between its end and the next event, or the end".to_owned()),
    };
    let message = format!("{what}: {message}");
    if is_late && !expected.pass {
        return failure(&message, "event", summary, repeat);
    }
    let mut status = TestCaseStatus::success();
    status.set_message(message);
    status
}

/// Breaches fail where the scenario expects a ratio; where it does not, the case says how many there were and
/// counts as skipped.
fn breaches(funnel: &FunnelSummary, summary: &Summary, repeat: &str) -> TestCaseStatus {
    if funnel.breaches == 0 && funnel.max_ratio.is_nan() {
        let mut status = TestCaseStatus::skipped();
        status.set_message("no diffusive term was known");
        return status;
    }
    if funnel.breaches == 0 {
        return TestCaseStatus::success();
    }
    let message = format!("{} node-ticks with |nu| >= psi", funnel.breaches);
    let expected = |expectation: &&Expectation| expectation.name == "funnel_ratio";
    if summary.expect.iter().find(expected).is_some_and(|expectation| !expectation.pass) {
        return failure(&message, "breaches", summary, repeat);
    }
    let mut status = TestCaseStatus::skipped();
    status.set_message(format!("{message}, which nothing is expected of"));
    status
}

fn case(name: &str, status: TestCaseStatus, summary: &Summary) -> TestCase {
    let mut case = TestCase::new(printable(name), status);
    case.set_classname(format!("sim-host.{}", summary.on));
    case
}

fn failure(message: &str, kind: &str, summary: &Summary, repeat: &str) -> TestCaseStatus {
    let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
    let message = printable(message);
    status.set_message(&*message);
    status.set_type(kind);
    status.set_description(format!("{message}\nseed {}, repeat with: {}", summary.seed, printable(repeat)));
    status
}

#[cfg(test)]
mod tests {
    use super::super::summary::tests::example;
    use super::*;
    use crate::judge::Check;

    #[test]
    fn every_expectation_is_a_case_and_failures_say_how_to_repeat() {
        let text = junit(&example(), "sim-host run a.toml --seed 1");
        assert_eq!(text.matches("<testcase ").count(), 5, "{text}");
        assert_eq!(text.matches("<failure ").count(), 2, "{text}");
        assert!(text.contains(r#"tests="5""#) && text.contains(r#"failures="2""#), "{text}");
        assert!(text.contains("final_spread is 0.5, allowed is below 0.1"), "{text}");
        assert!(text.contains("reference_error could not be measured"), "{text}");
        assert!(text.contains("repeat with: sim-host run a.toml --seed 1"), "{text}");
        assert!(text.contains("Five &lt;heterogeneous"), "{text}");
    }

    #[test]
    fn a_run_without_a_verdict_is_one_error_with_its_message() {
        let error = JunitError {
            scenario: "a<\u{1b}[2J>.toml",
            message: "first\u{fffe}\nsecond",
            exit: Exit::BadInput,
            command: "sim-host run",
        };
        let text = junit_error(&error);
        assert!(text.contains(r#"tests="1""#) && text.contains(r#"errors="1""#), "{text}");
        assert!(text.contains(r#"<error message="first\u{fffe}" type="refused">"#), "{text}");
        assert!(text.contains(r#"name="a&lt;\u{1b}[2J&gt;.toml""#) && text.contains("second"), "{text}");
    }

    #[test]
    fn no_character_that_is_none_of_xmls_gets_into_the_file() {
        let bad = "a\u{1b}]0;x\u{7}\u{fffe}\u{ffff}\u{9b}b";
        let mut summary = Summary { scenario: bad.into(), ..example() };
        summary.checks[0] = Check { name: "stopped", pass: false, text: bad.into() };
        let text = junit(&summary, bad);
        assert!(!text.contains(|c: char| c != '\n' && crate::printable::is_unprintable(c)), "{text}");
        assert!(text.contains(r"a\u{1b}]0;x\u{7}\u{fffe}\u{ffff}\u{9b}b"), "{text}");
    }
}

//! URScript, after *The URScript Programming Language*, e-Series, sections 1.3 to 1.7: functions, assignments, `if`, `while`,
//! calls with named arguments, lists; blocks end with `end`.

use std::ops::ControlFlow;

use vantage::planning::params::DialectParams;
use vantage::program::dialects::DialectFile;

use super::Said;

#[derive(Clone, Debug, PartialEq)]
enum Expr {
    Number(f64),
    Truth(bool),
    Text(String),
    Name(String),
    Item(String, Box<Expr>),
    List(Vec<Expr>),
    Call(String, Vec<Argument>),
    Not(Box<Expr>),
    Both(Box<Expr>, &'static str, Box<Expr>),
}

type Argument = (Option<String>, Expr);

#[derive(Clone, Debug, PartialEq)]
enum Statement {
    Def(String, Vec<String>, Vec<Statement>),
    Assign(String, Expr),
    Call(String, Vec<Argument>),
    If(Expr, Vec<Statement>),
    While(Expr, Vec<Statement>),
    Halt,
}

const KEYWORDS: [&str; 19] = [
    "and", "break", "continue", "def", "elif", "else", "end", "global", "halt", "if", "join", "kill", "local", "not", "or",
    "return", "run", "thread", "while",
];

fn both(a: Expr, operator: &'static str, b: Expr) -> Expr {
    Expr::Both(Box::new(a), operator, Box::new(b))
}

peg::parser! { grammar language() for str {
    rule _ = quiet! { [' ' | '\t']* }
    rule eol() = quiet! { (_ ("#" [^ '\n']*)? "\n")+ }
    rule letter() = ['a'..='z' | 'A'..='Z' | '0'..='9' | '_']
    rule key(word: &'static str) = _ found:$(letter()+) {? if found == word { Ok(()) } else { Err(word) } }
    rule name() -> String
        = _ word:$(['a'..='z' | 'A'..='Z' | '_'] letter()*) {?
            if KEYWORDS.contains(&word) { Err("a name") } else { Ok(word.to_owned()) }
        }
    rule number() -> f64 = _ digits:$("-"? ['0'..='9']+ ("." ['0'..='9']+)?) {? digits.parse().or(Err("a number")) }
    rule argument() -> Argument
        = name:name() _ "=" value:expression() { (Some(name), value) } / value:expression() { (None, value) }
    rule expression() -> Expr = precedence! {
        a:(@) key("or") b:@ { both(a, "or", b) }
        --
        key("not") a:@ { Expr::Not(Box::new(a)) }
        --
        a:(@) _ ">=" b:@ { both(a, ">=", b) }
        a:(@) _ ">" b:@ { both(a, ">", b) }
        a:(@) _ "<" b:@ { both(a, "<", b) }
        --
        a:(@) _ "-" b:@ { both(a, "-", b) }
        a:(@) _ "+" b:@ { both(a, "+", b) }
        --
        number:number() { Expr::Number(number) }
        key("True") { Expr::Truth(true) }
        key("False") { Expr::Truth(false) }
        _ "\"" text:$([' ' | '!' | '#'..='~']*) "\"" { Expr::Text(text.to_owned()) }
        _ "[" list:(expression() ** (_ ",")) _ "]" { Expr::List(list) }
        name:name() "(" list:(argument() ** (_ ",")) _ ")" { Expr::Call(name, list) }
        name:name() "[" index:expression() _ "]" { Expr::Item(name, Box::new(index)) }
        name:name() { Expr::Name(name) }
    }
    rule statement() -> Statement
        = key("halt") eol() { Statement::Halt }
        / key("def") name:name() "(" given:(name() ** (_ ",")) _ ")" _ ":" eol() inner:statement()* key("end") eol()
          { Statement::Def(name, given, inner) }
        / key("if") test:expression() _ ":" eol() inner:statement()* key("end") eol() { Statement::If(test, inner) }
        / key("while") test:expression() _ ":" eol() inner:statement()* key("end") eol() { Statement::While(test, inner) }
        / key("local")? name:name() _ "=" value:expression() eol() { Statement::Assign(name, value) }
        / name:name() "(" list:(argument() ** (_ ",")) _ ")" eol() { Statement::Call(name, list) }
    pub(super) rule script() -> Statement = eol()? program:statement() { program }
} }

/// Instructions that the script gives the robot; a movement leaves the table, or the arm, where it was.
pub(super) fn read(file: &DialectFile, params: &DialectParams) -> Vec<Said> {
    let program = language::script(&file.text).unwrap_or_else(|error| panic!("{error}\n{}", file.text));
    let Statement::Def(name, _, body) = program else { panic!("{program:?}") };
    assert_eq!(format!("{}.script", name.trim_end_matches("_program")), file.name);
    let function = |wanted: &str| {
        let found = body
            .iter()
            .find_map(|s| if let Statement::Def(name, _, inner) = s { (name == wanted).then_some(inner) } else { None });
        found.unwrap_or_else(|| panic!("no function {wanted}"))
    };
    let output = |on: bool| {
        let arguments = vec![(None, Expr::Number(f64::from(params.scan_output))), (None, Expr::Truth(on))];
        Statement::Call("set_standard_digital_out".to_owned(), arguments)
    };
    let sleep = |secs: f64| Statement::Call("sleep".to_owned(), vec![(None, Expr::Number(secs))]);
    let waited = || Expr::Name("waited".to_owned());
    let begin = || Statement::Assign("waited".to_owned(), Expr::Number(0.0));
    let wait_while = |test: Expr, reason: &str| {
        let stop = Statement::Call("vantage_stop".to_owned(), vec![(None, Expr::Text(reason.to_owned()))]);
        let is_over = both(waited(), ">=", Expr::Number(params.timeout_secs));
        let count = Statement::Assign("waited".to_owned(), both(waited(), "+", Expr::Number(0.01)));
        Statement::While(test, vec![Statement::If(is_over, vec![stop]), sleep(0.01), count])
    };
    let number = vec![(None, Expr::Number(f64::from(params.scan_input)))];
    let input = Expr::Call("get_standard_digital_in".to_owned(), number);
    let wanted = [
        begin(),
        wait_while(input.clone(), "The scanner's input stays on"),
        output(true),
        sleep(params.pulse_secs),
        output(false),
        begin(),
        wait_while(Expr::Not(Box::new(input)), "The scanner did not answer"),
    ];
    assert_eq!(function("vantage_scan").as_slice(), wanted);
    assert!(matches!(function("vantage_stop").last(), Some(Statement::Halt)));
    let mut here = home(function("vantage_require_home"));
    let mut said = vec![Said::Begin(here)];
    for statement in body.iter().filter(|statement| !matches!(statement, Statement::Def(..))) {
        let Statement::Call(name, arguments) = statement else { panic!("{statement:?}") };
        match (name.as_str(), arguments.as_slice()) {
            ("vantage_require_home", []) => continue,
            ("vantage_scan", []) => said.push(Said::Scan),
            ("sleep", [(None, Expr::Number(secs))]) => said.push(Said::Wait(*secs)),
            ("vantage_table", [(None, Expr::Number(angle_deg))]) => {
                here[6] = *angle_deg;
                said.push(Said::Go(here));
            }
            ("movej", [(None, joints), rest @ ..]) => {
                here[..6].copy_from_slice(&joints_deg(joints));
                check_speed(rest);
                said.push(Said::Go(here));
            }
            other => panic!("{other:?}"),
        }
    }
    said
}

/// Carries out a scan while the input stays on for some time, s; returns the time of the start pulse, s.
///
/// # Errors
/// Reason for which the script stops before the pulse.
pub(super) fn secs_of_pulse(file: &DialectFile, on_for_secs: f64) -> Result<f64, String> {
    let Ok(Statement::Def(_, _, body)) = language::script(&file.text) else { panic!("{}", file.text) };
    let scan = body
        .iter()
        .find_map(|s| if let Statement::Def(name, _, inner) = s { (name == "vantage_scan").then_some(inner) } else { None });
    let mut controller = Controller { secs: 0.0, waited: 0.0, on_for_secs };
    match controller.carry_out(scan.expect("a function for a scan")) {
        ControlFlow::Break(end) => end,
        ControlFlow::Continue(()) => panic!("a scan without a pulse"),
    }
}

/// A controller that carries out a function: time, variable and input.
struct Controller {
    secs: f64,
    waited: f64,
    on_for_secs: f64,
}

impl Controller {
    fn carry_out(&mut self, statements: &[Statement]) -> ControlFlow<Result<f64, String>> {
        for statement in statements {
            match statement {
                Statement::Assign(name, value) => {
                    assert_eq!(name, "waited");
                    self.waited = self.number(value);
                }
                Statement::If(test, inner) => {
                    if self.is_true(test) {
                        self.carry_out(inner)?;
                    }
                }
                Statement::While(test, inner) => {
                    while self.is_true(test) {
                        self.carry_out(inner)?;
                    }
                }
                Statement::Call(name, arguments) => match (name.as_str(), arguments.as_slice()) {
                    ("sleep", [(None, Expr::Number(secs))]) => self.secs += *secs,
                    ("vantage_stop", [(None, Expr::Text(reason))]) => return ControlFlow::Break(Err(reason.clone())),
                    ("set_standard_digital_out", [_, (None, Expr::Truth(true))]) => return ControlFlow::Break(Ok(self.secs)),
                    other => panic!("{other:?}"),
                },
                Statement::Def(..) | Statement::Halt => panic!("{statement:?}"),
            }
        }
        ControlFlow::Continue(())
    }

    fn number(&self, value: &Expr) -> f64 {
        if let Expr::Number(number) = value {
            return *number;
        }
        if let Expr::Both(a, "+", b) = value {
            return self.number(a) + self.number(b);
        }
        assert_eq!(*value, Expr::Name("waited".to_owned()));
        self.waited
    }

    fn is_true(&self, test: &Expr) -> bool {
        if let Expr::Both(a, ">=", b) = test {
            return self.number(a) >= self.number(b);
        }
        let Expr::Call(name, _) = test else { panic!("{test:?}") };
        assert_eq!(name, "get_standard_digital_in");
        self.secs < self.on_for_secs
    }
}

fn check_speed(arguments: &[Argument]) {
    let [(Some(a), Expr::Number(acceleration)), (Some(v), Expr::Number(speed)), time, radius] = arguments else {
        panic!("{arguments:?}")
    };
    assert_eq!((a.as_str(), v.as_str()), ("a", "v"));
    assert!(*acceleration > 0.0 && *speed > 0.0);
    let zero = |name: &str| (Some(name.to_owned()), Expr::Number(0.0));
    assert_eq!([time, radius], [&zero("t"), &zero("r")], "no time, and a stop");
}

fn joints_deg(list: &Expr) -> [f64; 6] {
    let Expr::List(items) = list else { panic!("{list:?}") };
    assert_eq!(items.len(), 6);
    std::array::from_fn(|joint| if let Expr::Number(rad) = items[joint] { rad.to_degrees() } else { panic!("{items:?}") })
}

/// Configuration at which the script demands to begin. It cannot read the table's angle: an operator confirms it before the table
/// turns.
fn home(require_home: &[Statement]) -> [f64; 7] {
    let (Statement::Assign(_, joints), Some(Statement::Call(table, angle))) = (&require_home[0], require_home.last()) else {
        panic!("{require_home:?}")
    };
    assert_eq!(table, "vantage_table");
    let [(None, Expr::Number(table_deg))] = angle.as_slice() else { panic!("{angle:?}") };
    let [.., Statement::Call(popup, asked), _] = require_home else { panic!("{require_home:?}") };
    let [(None, Expr::Text(question)), options @ ..] = asked.as_slice() else { panic!("{asked:?}") };
    assert_eq!(popup, "popup");
    assert!(question.starts_with(&format!("Turn the table to {table_deg:.4} deg by hand, within 0.5 deg.")), "{question}");
    let blocks = (Some("blocking".to_owned()), Expr::Truth(true));
    assert!(options.contains(&blocks), "the program waits for the operator: {options:?}");
    let joints = joints_deg(joints);
    std::array::from_fn(|axis| joints.get(axis).copied().unwrap_or(*table_deg))
}

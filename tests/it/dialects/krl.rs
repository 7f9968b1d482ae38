//! KRL, after *KSS 8.3 Operating and Programming Instructions for System Integrators*, chapter on KRL: one statement a line,
//! a module's `.src` with the program and its local subprograms, a `.dat` with its points.

use vantage::planning::params::DialectParams;
use vantage::program::dialects::DialectFile;

use super::Said;

#[derive(Clone, Debug, PartialEq)]
enum Expr {
    Number(f64),
    Truth(bool),
    /// A variable with its index and parts, as written.
    Variable(String),
    Enumerated(String),
    Call(String, Vec<Expr>),
    Not(Box<Expr>),
    Both(Box<Expr>, &'static str, Box<Expr>),
}

#[derive(Clone, Debug, PartialEq)]
enum Statement {
    Declare(String),
    Assign(String, Expr),
    Call(String, Vec<Expr>),
    Ptp(String),
    WaitSecs(f64),
    If(Expr, Vec<Statement>),
    While(Expr, Vec<Statement>),
    For(String, Expr, Expr, Vec<Statement>),
    Return(Expr),
    Halt,
}

/// A subprogram: its name and what it does.
type Routine = (String, Vec<Statement>);
/// A point: its name, and names and angles of its axes.
type Point = (String, Vec<(String, f64)>);

const KEYWORDS: [&str; 22] = [
    "DEF", "END", "DEFFCT", "ENDFCT", "DEFDAT", "ENDDAT", "DECL", "INT", "BOOL", "IF", "THEN", "ENDIF", "WHILE", "ENDWHILE",
    "FOR", "TO", "ENDFOR", "HALT", "RETURN", "WAIT", "PTP", "NOT",
];

fn both(a: Expr, operator: &'static str, b: Expr) -> Expr {
    Expr::Both(Box::new(a), operator, Box::new(b))
}

peg::parser! { grammar language() for str {
    rule _ = quiet! { [' ' | '\t']* }
    rule end() = quiet! { _ (";" [^ '\n']*)? "\n" }
    /// The end of a statement, and lines with comments alone.
    rule eol() = end()+
    rule letter() = ['a'..='z' | 'A'..='Z' | '0'..='9' | '_']
    rule key(word: &'static str) = _ found:$(letter()+) {? if found == word { Ok(()) } else { Err(word) } }
    rule name() -> String
        = _ word:$(['A'..='Z' | 'a'..='z' | '_' | '$'] letter()*) {?
            if word.len() <= 24 && !KEYWORDS.contains(&word) { Ok(word.to_owned()) } else { Err("a name of at most 24 characters") }
        }
    rule variable() -> String
        = name:name() index:$("[" letter()+ "]")? part:$("." letter()+)? { name + index.unwrap_or("") + part.unwrap_or("") }
    rule number() -> f64 = _ digits:$("-"? ['0'..='9']+ ("." ['0'..='9']+)?) {? digits.parse().or(Err("a number")) }
    rule list() -> Vec<Expr> = expression() ** (_ ",")
    rule expression() -> Expr = precedence! {
        a:(@) key("OR") b:@ { both(a, "OR", b) }
        --
        a:(@) _ ">" b:@ { both(a, ">", b) }
        --
        a:(@) _ "-" b:@ { both(a, "-", b) }
        --
        key("NOT") a:@ { Expr::Not(Box::new(a)) }
        --
        number:number() { Expr::Number(number) }
        key("TRUE") { Expr::Truth(true) }
        key("FALSE") { Expr::Truth(false) }
        _ "#" name:name() { Expr::Enumerated(name) }
        _ "(" inner:expression() _ ")" { inner }
        name:name() _ "(" list:list() _ ")" { Expr::Call(name, list) }
        variable:variable() { Expr::Variable(variable) }
    }
    rule statement() -> Statement
        = key("DECL") key("INT") name:name() eol() { Statement::Declare(name) }
        / key("PTP") name:name() eol() { Statement::Ptp(name) }
        / key("WAIT") key("SEC") secs:number() eol() { Statement::WaitSecs(secs) }
        / key("HALT") eol() { Statement::Halt }
        / key("RETURN") value:expression() eol() { Statement::Return(value) }
        / key("IF") test:expression() key("THEN") eol() inner:statement()* key("ENDIF") eol() { Statement::If(test, inner) }
        / key("WHILE") test:expression() eol() inner:statement()* key("ENDWHILE") eol() { Statement::While(test, inner) }
        / key("FOR") name:name() _ "=" from:expression() key("TO") to:expression() eol() inner:statement()* key("ENDFOR") eol()
          { Statement::For(name, from, to, inner) }
        / name:name() _ "(" list:list() _ ")" eol() { Statement::Call(name, list) }
        / variable:variable() _ "=" value:expression() eol() { Statement::Assign(variable, value) }
    rule attributes() = ("&" [^ '\n']* "\n")*
    rule routine() -> Routine
        = key("DEF") name:name() _ "(" _ ")" eol() body:statement()* key("END") eol() { (name, body) }
        / key("DEFFCT") key("BOOL") name:name() _ "(" _ ")" eol() body:statement()* key("ENDFCT") eol() { (name, body) }
    rule axis() -> (String, f64) = name:name() _ angle:number() { (name, angle) }
    rule point() -> Point
        = key("DECL") key("E6AXIS") name:name() _ "=" _ "{" axes:(axis() ++ (_ ",")) _ "}" eol() { (name, axes) }
    pub(super) rule src() -> Vec<Routine> = attributes() routines:routine()+ { routines }
    pub(super) rule dat() -> (String, Vec<Point>)
        = attributes() key("DEFDAT") name:name() eol() points:point()* key("ENDDAT") eol() { (name, points) }
} }

/// Instructions that the program gives the robot.
pub(super) fn read(files: &[DialectFile], params: &DialectParams) -> Vec<Said> {
    let [src, dat] = files else { panic!("two files, not {}", files.len()) };
    assert!(files.iter().all(|file| file.text.lines().all(|line| line.len() <= 140)));
    let routines = language::src(&src.text).unwrap_or_else(|error| panic!("{error}\n{}", src.text));
    let (name, points) = language::dat(&dat.text).unwrap_or_else(|error| panic!("{error}\n{}", dat.text));
    let module = Module { routines, points };
    let (program, body) = &module.routines[0];
    assert_eq!((format!("{program}.src"), format!("{name}.dat")), (src.name.clone(), dat.name.clone()));
    assert_eq!(&name, program);
    module.check_scan(params);
    let mut said: Vec<Said> = body.iter().filter_map(|statement| module.say(statement, params)).collect();
    // The first motion is for the controller's block coincidence.
    assert_eq!(said.remove(1), Said::Go(module.point("XHOME", params)));
    said
}

struct Module {
    routines: Vec<Routine>,
    points: Vec<Point>,
}

impl Module {
    fn routine(&self, name: &str) -> &[Statement] {
        &self.routines.iter().find(|(own, _)| own == name).unwrap_or_else(|| panic!("no routine {name}")).1
    }

    fn check_scan(&self, params: &DialectParams) {
        let output = format!("$OUT[{}]", params.scan_output);
        let on = |on: bool| Statement::Assign(output.clone(), Expr::Truth(on));
        let scan = self.routine("SCAN_VIEW");
        let input = Expr::Variable(format!("$IN[{}]", params.scan_input));
        let stop = |stands: bool| Statement::Assign("$TIMER_STOP[10]".to_owned(), Expr::Truth(stands));
        let reset = Statement::Assign("$TIMER[10]".to_owned(), Expr::Number(0.0));
        let is_over = both(Expr::Variable("$TIMER[10]".to_owned()), ">", Expr::Number(1000.0 * params.timeout_secs));
        let halt = Statement::If(is_over, vec![Statement::Halt, reset.clone()]);
        let wait_while = |test: Expr| Statement::While(test, vec![halt.clone()]);
        let wanted = [
            reset.clone(),
            stop(false),
            wait_while(input.clone()),
            on(true),
            Statement::WaitSecs(params.pulse_secs),
            on(false),
            reset.clone(),
            wait_while(Expr::Not(Box::new(input))),
            stop(true),
        ];
        assert_eq!(scan, wanted);
        let away = self.routine("IS_AWAY");
        assert_eq!(away.len(), 8, "seven axes, and FALSE");
        assert_eq!(away.last(), Some(&Statement::Return(Expr::Truth(false))));
    }

    fn say(&self, statement: &Statement, params: &DialectParams) -> Option<Said> {
        match statement {
            Statement::While(Expr::Call(name, _), inner) if name == "IS_AWAY" => {
                assert_eq!(inner, &[Statement::Halt]);
                Some(Said::Begin(self.point("XHOME", params)))
            }
            Statement::Ptp(point) => Some(Said::Go(self.point(point, params))),
            Statement::WaitSecs(secs) => Some(Said::Wait(*secs)),
            Statement::Call(name, none) if name == "SCAN_VIEW" && none.is_empty() => Some(Said::Scan),
            Statement::Call(name, _) => {
                assert_eq!(name, "BAS");
                None
            }
            Statement::For(..) | Statement::Declare(_) => None,
            Statement::Assign(name, Expr::Number(percent)) => {
                let axis = params.table_axis;
                assert!(
                    [format!("$VEL_EXTAX[{axis}]"), format!("$ACC_EXTAX[{axis}]")].contains(name)
                        && (1.0..=100.0).contains(percent)
                );
                None
            }
            other @ (Statement::While(..)
            | Statement::Assign(..)
            | Statement::If(..)
            | Statement::Return(_)
            | Statement::Halt) => panic!("{other:?}"),
        }
    }

    fn point(&self, name: &str, params: &DialectParams) -> [f64; 7] {
        let axes = &self.points.iter().find(|(own, _)| own == name).unwrap_or_else(|| panic!("no point {name}")).1;
        let names: Vec<_> = axes.iter().map(|(name, _)| name.clone()).collect();
        assert_eq!(names, ["A1", "A2", "A3", "A4", "A5", "A6", &format!("E{}", params.table_axis)]);
        std::array::from_fn(|index| axes[index].1)
    }
}

//! RAPID, after *Technical reference manual, RAPID overview* (3HAC050947): a module of data declarations and routines;
//! statements are calls with optional arguments, assignments, IF and EXIT.

use vantage::planning::params::DialectParams;
use vantage::program::dialects::DialectFile;

use super::Said;

#[derive(Clone, Debug, PartialEq)]
enum Expr {
    Number(f64),
    Text(String),
    Name(String),
    Call(String, Vec<Expr>),
    Aggregate(Vec<Expr>),
    Both(Box<Expr>, &'static str, Box<Expr>),
}

#[derive(Clone, Debug, PartialEq)]
enum Argument {
    Required(Expr),
    Optional(String, Option<Expr>),
}

#[derive(Clone, Debug, PartialEq)]
enum Statement {
    Call(String, Vec<Argument>),
    Assign(String, Expr),
    Declare(String, String),
    If(Expr, Vec<Statement>),
    Exit,
}

#[derive(Debug)]
struct Data {
    name: String,
    kind: String,
    value: Option<Expr>,
}

#[derive(Debug)]
struct Module {
    name: String,
    data: Vec<Data>,
    routines: Vec<(String, Vec<Statement>)>,
}

const RESERVED: [&str; 19] = [
    "MODULE",
    "ENDMODULE",
    "PROC",
    "ENDPROC",
    "LOCAL",
    "CONST",
    "VAR",
    "PERS",
    "IF",
    "THEN",
    "ELSE",
    "ENDIF",
    "AND",
    "OR",
    "NOT",
    "EXIT",
    "WHILE",
    "FOR",
    "RETURN",
];

fn both(a: Expr, operator: &'static str, b: Expr) -> Expr {
    Expr::Both(Box::new(a), operator, Box::new(b))
}

peg::parser! { grammar language() for str {
    rule _ = quiet! { ([' ' | '\t' | '\r' | '\n'] / ("!" [^ '\n']*))* }
    rule letter() = ['a'..='z' | 'A'..='Z' | '0'..='9' | '_']
    rule key(word: &'static str) = _ found:$(letter()+) {? if found.eq_ignore_ascii_case(word) { Ok(()) } else { Err(word) } }
    rule name() -> String
        = _ word:$(['a'..='z' | 'A'..='Z'] letter()*) {?
            let is_name = word.len() <= 32 && !RESERVED.contains(&word.to_ascii_uppercase().as_str());
            if is_name { Ok(word.to_owned()) } else { Err("a name of at most 32 characters") }
        }
    rule path() -> String = first:name() rest:$(("." letter()+)*) { first + rest }
    rule number() -> f64
        = _ digits:$("-"? ['0'..='9']+ ("." ['0'..='9']+)? ("E" ['0'..='9']+)?) {? digits.parse().or(Err("a number")) }
    rule text() -> String = _ "\"" text:$([' ' | '!' | '#'..='~']*<0,80>) "\"" { text.to_owned() }
    rule list() -> Vec<Expr> = expression() ** (_ ",")
    rule expression() -> Expr = precedence! {
        a:(@) key("OR") b:@ { both(a, "OR", b) }
        --
        a:(@) key("AND") b:@ { both(a, "AND", b) }
        --
        a:(@) _ ">" b:@ { both(a, ">", b) }
        a:(@) _ "<" b:@ { both(a, "<", b) }
        --
        a:(@) _ "-" b:@ { both(a, "-", b) }
        a:(@) _ "+" b:@ { both(a, "+", b) }
        --
        number:number() { Expr::Number(number) }
        text:text() { Expr::Text(text) }
        _ "[" list:list() _ "]" { Expr::Aggregate(list) }
        _ "(" inner:expression() _ ")" { inner }
        name:name() _ "(" list:list() _ ")" { Expr::Call(name, list) }
        path:path() { Expr::Name(path) }
    }
    rule optional() -> Argument
        = _ "\\" name:name() value:(_ ":=" value:expression() { value })? { Argument::Optional(name, value) }
    rule required() -> Vec<Argument>
        = value:expression() optional:optional()* { [vec![Argument::Required(value)], optional].concat() }
    rule arguments() -> Vec<Argument>
        = first:optional()+ rest:(_ "," next:required() { next })* { [first, rest.concat()].concat() }
        / all:required() ** (_ ",") { all.concat() }
    rule statement() -> Statement
        = key("EXIT") _ ";" { Statement::Exit }
        / key("IF") test:expression() key("THEN") inner:statement()* key("ENDIF") { Statement::If(test, inner) }
        / key("VAR") kind:name() name:name() _ ";" { Statement::Declare(kind, name) }
        / path:path() _ ":=" value:expression() _ ";" { Statement::Assign(path, value) }
        / name:name() arguments:arguments() _ ";" { Statement::Call(name, arguments) }
    rule data() -> Data
        = key("LOCAL")? (key("CONST") / key("VAR") / key("PERS")) kind:name() name:name()
          value:(_ ":=" value:expression() { value })? _ ";" { Data { name, kind, value } }
    rule routine() -> (String, Vec<Statement>)
        = key("LOCAL")? key("PROC") name:name() _ "(" _ ")" body:statement()* key("ENDPROC") { (name, body) }
    pub(super) rule module() -> Module
        = key("MODULE") name:name() data:data()* routines:routine()* key("ENDMODULE") _ { Module { name, data, routines } }
} }

/// Instructions that the module's program gives the robot.
pub(super) fn read(file: &DialectFile, params: &DialectParams) -> Vec<Said> {
    let module = language::module(&file.text).unwrap_or_else(|error| panic!("{error}\n{}", file.text));
    assert_eq!(format!("{}.mod", module.name), file.name);
    let names: Vec<_> = module.data.iter().map(|data| &data.name).chain(module.routines.iter().map(|(name, _)| name)).collect();
    assert!(names.iter().all(|name| names.iter().filter(|other| other.eq_ignore_ascii_case(name)).count() == 1), "{names:?}");
    assert_eq!(module.routine("scan"), language_of_a_scan(params));
    module.routine(&format!("{}_run", module.name)).iter().filter_map(|statement| module.say(statement, params)).collect()
}

fn required(number: f64) -> Argument {
    Argument::Required(Expr::Number(number))
}

fn named(name: &str) -> Argument {
    Argument::Required(Expr::Name(name.to_owned()))
}

fn language_of_a_scan(params: &DialectParams) -> Vec<Statement> {
    let call = |name: &str, arguments: &[Argument]| Statement::Call(name.to_owned(), arguments.to_vec());
    let longest = Argument::Optional("MaxTime".to_owned(), Some(Expr::Number(params.timeout_secs)));
    vec![
        call("WaitDI", &[named("scan_input"), required(0.0), longest.clone()]),
        call("SetDO", &[named("scan_output"), required(1.0)]),
        call("WaitTime", &[required(params.pulse_secs)]),
        call("SetDO", &[named("scan_output"), required(0.0)]),
        call("WaitDI", &[named("scan_input"), required(1.0), longest]),
    ]
}

impl Module {
    fn routine(&self, name: &str) -> Vec<Statement> {
        self.routines.iter().find(|(own, _)| own == name).unwrap_or_else(|| panic!("no routine {name}")).1.clone()
    }

    fn say(&self, statement: &Statement, params: &DialectParams) -> Option<Said> {
        let Statement::Call(name, arguments) = statement else { panic!("{statement:?}") };
        match (name.as_str(), arguments.as_slice()) {
            ("require_home", []) => {
                assert!(
                    matches!(self.routine("require_home").last(), Some(Statement::If(_, inner)) if inner.last() == Some(&Statement::Exit))
                );
                Some(Said::Begin(self.point("p0", params)))
            }
            ("scan", []) => Some(Said::Scan),
            ("AliasIO", [Argument::Required(Expr::Name(signal)), alias]) => {
                let data = self.data.iter().find(|data| data.name == *signal && data.kind == "string");
                let value = data.and_then(|data| data.value.clone());
                let wanted =
                    [(format!("DO_{}", params.scan_output), "scan_output"), (format!("DI_{}", params.scan_input), "scan_input")];
                assert!(wanted.iter().any(|(text, name)| value == Some(Expr::Text(text.clone())) && *alias == named(name)));
                None
            }
            ("AccSet", [Argument::Required(Expr::Number(share)), _]) => {
                assert!((20.0..=100.0).contains(share));
                None
            }
            ("WaitTime", [Argument::Optional(switch, None), Argument::Required(Expr::Number(secs))]) => {
                assert_eq!(switch, "InPos");
                Some(Said::Wait(*secs))
            }
            (
                "MoveAbsJ",
                [
                    Argument::Required(Expr::Name(point)),
                    offsets,
                    speed,
                    Argument::Optional(time, Some(Expr::Number(secs))),
                    zone,
                    tool,
                ],
            ) => {
                assert_eq!((offsets, time.as_str()), (&Argument::Optional("NoEOffs".to_owned(), None), "T"));
                assert_eq!([speed, zone, tool], [&named("vmax"), &named("fine"), &named("tool0")]);
                assert!(*secs > 0.0);
                Some(Said::Go(self.point(point, params)))
            }
            other => panic!("{other:?}"),
        }
    }

    /// Joints 1 to 6 and the table of a joint target.
    fn point(&self, name: &str, params: &DialectParams) -> [f64; 7] {
        let data = self.data.iter().find(|data| data.name == name).unwrap_or_else(|| panic!("no point {name}"));
        assert_eq!(data.kind, "jointtarget");
        let Some(Expr::Aggregate(parts)) = &data.value else { panic!("{data:?}") };
        let numbers = |part: &Expr| -> Vec<f64> {
            let Expr::Aggregate(numbers) = part else { panic!("{part:?}") };
            numbers.iter().map(|n| if let Expr::Number(n) = n { *n } else { panic!("{n:?}") }).collect()
        };
        let (joints, external) = (numbers(&parts[0]), numbers(&parts[1]));
        assert_eq!((parts.len(), joints.len(), external.len()), (2, 6, 6));
        let axis = params.table_axis as usize - 1;
        assert!(external.iter().enumerate().all(|(index, angle)| (index == axis) != (*angle == 9e9)));
        std::array::from_fn(|index| joints.get(index).copied().unwrap_or(external[axis]))
    }
}

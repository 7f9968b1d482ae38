//! FANUC TP in ASCII, after *R-30iB Operator's Manual* (B-83284EN), chapters on program instructions and on the ASCII form:
//! attributes, numbered lines that each end with a semicolon, positions of two motion groups.

use vantage::planning::params::DialectParams;
use vantage::program::dialects::DialectFile;

use super::Said;

#[derive(Clone, Debug, PartialEq)]
enum Line {
    Remark(String),
    System(String, u32),
    Joint { position: usize, percent: u32, acceleration: Option<u32> },
    Wait(f64),
    Output(u32, bool),
    WaitInput { input: u32, on: bool, label: u32 },
    Label(u32),
    Message(String),
    End,
    Abort,
}

#[derive(Debug)]
struct Program {
    name: String,
    attributes: Vec<(String, String)>,
    lines: Vec<(usize, Line)>,
    positions: Vec<(usize, [f64; 7])>,
}

peg::parser! { grammar language() for str {
    rule _ = quiet! { [' ' | '\t']* }
    rule eol() = _ "\n"
    rule whole() -> u32 = digits:$(['0'..='9']+) {? digits.parse().or(Err("a whole number")) }
    rule real() -> f64 = digits:$("-"? ['0'..='9']* "." ['0'..='9']+) {? digits.parse().or(Err("a number with a point")) }
    rule name() -> String = word:$(['A'..='Z'] ['A'..='Z' | '0'..='9' | '_']*) { word.to_owned() }
    /// Text that may stand in a remark, a message or a comment, at most so many characters.
    rule words(most: usize) -> String
        = text:$(['A'..='Z' | 'a'..='z' | '0'..='9' | ' ' | '!' | '#'..='/' | ':' | '<'..='@' | '[' | '\\' | '^'..='`' | '{'..='~']*) {?
            if text.trim_end().len() <= most { Ok(text.to_owned()) } else { Err("a shorter text") }
        }
    rule attribute() -> (String, String)
        = !"/" _ "TCD:"? _ name:name() _ "=" _ value:$([^ ';' | ',' | '\n']* ("," ['*' | '1'])*) [';' | ','] eol() { (name, value.to_owned()) }
    rule line() -> Line
        = "!" text:words(32) { Line::Remark(text.trim_end().to_owned()) }
        / "$" name:name() "=" value:whole() { Line::System(name, value) }
        / "J P[" position:whole() "] " percent:whole() "% FINE" acceleration:(" ACC" value:whole() { value })?
          { Line::Joint { position: position as usize, percent, acceleration } }
        / "WAIT" _ secs:real() "(sec)" { Line::Wait(secs) }
        / "WAIT DI[" input:whole() "]=" on:$("ON" / "OFF") " TIMEOUT,LBL[" label:whole() "]"
          { Line::WaitInput { input, on: on == "ON", label } }
        / "DO[" output:whole() "]=" on:$("ON" / "OFF") { Line::Output(output, on == "ON") }
        / "LBL[" label:whole() (":" words(16))? "]" { Line::Label(label) }
        / "MESSAGE[" text:$(['A'..='Z' | '0'..='9' | ' ']*<1,24>) "]" { Line::Message(text.to_owned()) }
        / "END" { Line::End }
        / "ABORT" { Line::Abort }
    rule numbered() -> (usize, Line) = _ number:whole() ":" _ line:line() _ ";" eol() { (number as usize, line) }
    rule joint(number: u32) -> f64
        = _ "J" own:whole() "=" _ angle:real() _ "deg" {? if own == number { Ok(angle) } else { Err("the joints in order") } }
    rule frames() = _ "UF" _ ":" _ "0" _ "," _ "UT" _ ":" _ "1" _ "," eol()
    rule position() -> (usize, [f64; 7])
        = "P[" number:whole() (":\"" words(16) "\"")? "]{" eol()
          _ "GP1:" eol() frames()
          a:joint(1) "," b:joint(2) "," c:joint(3) "," eol()
          d:joint(4) "," e:joint(5) "," f:joint(6) eol()
          _ "GP2:" eol() frames()
          g:joint(1) eol()
          "};" eol() { (number as usize, [a, b, c, d, e, f, g]) }
    pub(super) rule program() -> Program
        = "/PROG" _ name:name() eol() "/ATTR" eol() attributes:attribute()* "/APPL" eol() "/MN" eol() lines:numbered()*
          "/POS" eol() positions:position()* "/END" eol()
          { Program { name, attributes, lines, positions } }
} }

/// Instructions that the program gives the robot.
pub(super) fn read(file: &DialectFile, params: &DialectParams) -> Vec<Said> {
    let program = language::program(&file.text).unwrap_or_else(|error| panic!("{error}\n{}", file.text));
    assert_eq!(format!("{}.ls", program.name), file.name);
    assert!(program.name.len() <= params.fanuc_name_chars as usize);
    let attribute = |name: &str| &program.attributes.iter().find(|(own, _)| own == name).expect("an attribute").1;
    assert_eq!(attribute("LINE_COUNT"), &program.lines.len().to_string());
    assert_eq!(attribute("DEFAULT_GROUP"), "1,1,*,*,*");
    assert!(attribute("COMMENT").len() <= 18, "16 and the quotes");
    assert!(program.lines.iter().enumerate().all(|(index, (number, _))| *number == index + 1));
    assert!(program.positions.iter().enumerate().all(|(index, (number, _))| *number == index + 1));
    let lines: Vec<_> = program.lines.iter().map(|(_, line)| line).filter(|line| !matches!(line, Line::Remark(_))).collect();
    let last = lines.iter().position(|line| **line == Line::End).expect("an end");
    let message = |text: &str| Line::Message(text.to_owned());
    let late = [Line::Label(99), message("SCANNER DID NOT ANSWER"), Line::Abort];
    let held = [Line::Label(98), message("SCANNER INPUT STAYS ON"), Line::Abort];
    assert!(lines[last + 1..].iter().copied().eq(late.iter().chain(&held)), "{lines:?}");
    let timeout = (100.0 * params.timeout_secs).ceil() as u32;
    assert_eq!(lines[0], &Line::System("WAITTMOUT".to_owned(), timeout));
    said(&program, &lines[1..last], params)
}

fn said(program: &Program, lines: &[&Line], params: &DialectParams) -> Vec<Said> {
    let at = |position: usize| program.positions[position - 1].1;
    let mut said = Vec::new();
    let mut rest = lines;
    while let Some((first, others)) = rest.split_first() {
        rest = others;
        said.push(match first {
            // The way home is slow, and no part of what was checked.
            Line::Joint { position: 1, percent: 5, acceleration: None } => Said::Begin(at(1)),
            Line::Joint { position, percent, acceleration } => {
                assert_eq!(Some(*percent), *acceleration);
                Said::Go(at(*position))
            }
            Line::Wait(secs) => Said::Wait(*secs),
            Line::WaitInput { input, on: false, label: 98 } => {
                assert_eq!(*input, params.scan_input);
                let wanted = [
                    Line::Output(params.scan_output, true),
                    Line::Wait(params.pulse_secs),
                    Line::Output(params.scan_output, false),
                    Line::WaitInput { input: params.scan_input, on: true, label: 99 },
                ];
                assert!(rest[..4].iter().copied().eq(&wanted), "{rest:?}");
                rest = &rest[4..];
                Said::Scan
            }
            other @ (Line::Remark(_)
            | Line::System(..)
            | Line::Output(..)
            | Line::WaitInput { .. }
            | Line::Label(_)
            | Line::Message(_)
            | Line::End
            | Line::Abort) => panic!("{other:?}"),
        });
    }
    said
}

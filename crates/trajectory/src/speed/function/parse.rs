//! Parser of speed expressions, by recursive descent.

use super::{BinaryOperator, ExpressionError, SyntaxNode, UnaryFunction};

/// Maximum length of a text, bytes.
const MAX_LENGTH: usize = 1000;
/// Deepest nesting of parentheses, signs and powers: bounds the stack of the parser.
const DEEPEST: usize = 100;
/// Largest height of the tree: bounds the stack of every walk over it. A sum of `n` terms has the
/// height `n`, as each operator holds those on its left.
const TALLEST: usize = 250;

/// Parses `text` into a tree.
pub(super) fn parse_expression(text: &str) -> Result<SyntaxNode, ExpressionError> {
    if text.len() > MAX_LENGTH {
        return Err(ExpressionError::TooLong { bytes: text.len(), limit: MAX_LENGTH });
    }
    let mut parser = ExpressionParser { text, at: 0, depth: 0 };
    let (node, _) = parser.sum()?;
    match parser.peek() {
        None => Ok(node),
        Some(_) => Err(parser.unexpected("an operator or the end")),
    }
}

/// A tree and its height.
type SizedTree = (SyntaxNode, usize);

struct ExpressionParser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
}

impl ExpressionParser<'_> {
    /// The next character that is not a space; its place is in `at`.
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
        self.text[self.at..].chars().next()
    }

    fn takes(&mut self, symbol: &str) -> bool {
        let found = self.peek().is_some() && self.text[self.at..].starts_with(symbol);
        self.at += if found { symbol.len() } else { 0 };
        found
    }

    fn unexpected(&mut self, expected: &'static str) -> ExpressionError {
        let found = self.peek().map_or_else(|| "the end".to_owned(), |c| format!("`{c}`"));
        ExpressionError::Syntax { at: self.at, expected, found }
    }

    fn too_deep(&self, limit: usize) -> ExpressionError {
        ExpressionError::TooDeep { at: self.at, limit }
    }

    fn join(&self, op: BinaryOperator, a: SizedTree, b: SizedTree) -> Result<SizedTree, ExpressionError> {
        let height = 1 + a.1.max(b.1);
        if height > TALLEST {
            Err(self.too_deep(TALLEST))
        } else {
            Ok((SyntaxNode::Binary(op, Box::new([a.0, b.0])), height))
        }
    }

    fn sum(&mut self) -> Result<SizedTree, ExpressionError> {
        let mut left = self.product()?;
        loop {
            let op = match self.peek() {
                Some('+') => BinaryOperator::Add,
                Some('-') => BinaryOperator::Subtract,
                _ => return Ok(left),
            };
            self.at += 1;
            let right = self.product()?;
            left = self.join(op, left, right)?;
        }
    }

    fn product(&mut self) -> Result<SizedTree, ExpressionError> {
        let mut left = self.sign()?;
        loop {
            let op = match self.peek() {
                Some('*') => BinaryOperator::Multiply,
                Some('/') => BinaryOperator::Divide,
                _ => return Ok(left),
            };
            self.at += 1;
            let right = self.sign()?;
            left = self.join(op, left, right)?;
        }
    }

    /// Every path to nested text leads through this function, so depth is counted here.
    fn sign(&mut self) -> Result<SizedTree, ExpressionError> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.too_deep(DEEPEST));
        }
        // A sign binds less than a power: `-t^2` is `-(t^2)`.
        let signed = if self.takes("-") {
            let (node, height) = self.sign()?;
            (SyntaxNode::Negated(Box::new(node)), height + 1)
        } else if self.takes("+") {
            self.sign()?
        } else {
            self.power()?
        };
        self.depth -= 1;
        Ok(signed)
    }

    fn power(&mut self) -> Result<SizedTree, ExpressionError> {
        let base = self.atom()?;
        if self.takes("**") || self.takes("^") {
            // Through `sign`, so that powers associate to the right and an exponent may be
            // negative.
            let exponent = self.sign()?;
            return self.join(BinaryOperator::Power, base, exponent);
        }
        Ok(base)
    }

    fn atom(&mut self) -> Result<SizedTree, ExpressionError> {
        match self.peek() {
            Some('(') => {
                self.at += 1;
                let inner = self.sum()?;
                self.close("an operator or `)`")?;
                Ok(inner)
            }
            Some(c) if c.is_ascii_digit() || c == '.' => Ok((SyntaxNode::Number(self.number()?), 1)),
            Some(c) if c.is_ascii_alphabetic() => self.named(),
            _ => Err(self.unexpected("a number, t, pi, e, a function or `(`")),
        }
    }

    fn close(&mut self, expected: &'static str) -> Result<(), ExpressionError> {
        if self.takes(")") { Ok(()) } else { Err(self.unexpected(expected)) }
    }

    /// Digits, a point and digits, and an exponent only if a digit follows the `e`. `2e` is the
    /// number 2 before the name `e`, which the grammar refuses.
    fn number(&mut self) -> Result<f64, ExpressionError> {
        let rest = &self.text[self.at..];
        let digits = |s: &str| s.bytes().take_while(u8::is_ascii_digit).count();
        let whole = digits(rest);
        let mut end = whole;
        if rest[end..].starts_with('.') {
            end += 1 + digits(&rest[end + 1..]);
        }
        if let Some(exponent) = rest[end..].strip_prefix(['e', 'E']) {
            let sign = usize::from(exponent.starts_with(['+', '-']));
            let power = digits(&exponent[sign..]);
            end += if power > 0 { 1 + sign + power } else { 0 };
        }
        match rest[..end].parse::<f64>() {
            Ok(value) if value.is_finite() => {
                self.at += end;
                Ok(value)
            }
            _ => Err(ExpressionError::Syntax {
                at: self.at,
                expected: "a decimal number below 1.8e308",
                found: format!("`{}`", &rest[..end]),
            }),
        }
    }

    fn named(&mut self) -> Result<SizedTree, ExpressionError> {
        let at = self.at;
        let rest = &self.text[at..];
        let name = &rest[..rest.bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count()];
        self.at += name.len();
        let function = match name {
            "t" => return Ok((SyntaxNode::T, 1)),
            "pi" => return Ok((SyntaxNode::Pi, 1)),
            "e" => return Ok((SyntaxNode::E, 1)),
            "min" => return self.extreme(BinaryOperator::Min),
            "max" => return self.extreme(BinaryOperator::Max),
            "sin" => UnaryFunction::Sin,
            "cos" => UnaryFunction::Cos,
            "tan" => UnaryFunction::Tan,
            "exp" => UnaryFunction::Exp,
            "log" => UnaryFunction::Log,
            "sqrt" => UnaryFunction::Sqrt,
            "abs" => UnaryFunction::Abs,
            _ => return Err(ExpressionError::Name { at, name: name.to_owned() }),
        };
        self.open()?;
        let (argument, height) = self.sum()?;
        self.close("an operator or `)`")?;
        Ok((SyntaxNode::Call(function, Box::new(argument)), height + 1))
    }

    fn open(&mut self) -> Result<(), ExpressionError> {
        if self.takes("(") { Ok(()) } else { Err(self.unexpected("`(`")) }
    }

    /// The arguments of `min` or `max`, two or more.
    fn extreme(&mut self, op: BinaryOperator) -> Result<SizedTree, ExpressionError> {
        self.open()?;
        let mut left = self.sum()?;
        if !self.takes(",") {
            return Err(self.unexpected("an operator or `,`"));
        }
        loop {
            let right = self.sum()?;
            left = self.join(op, left, right)?;
            if !self.takes(",") {
                self.close("an operator, `,` or `)`")?;
                return Ok(left);
            }
        }
    }
}

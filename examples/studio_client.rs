//! Run with: cargo run --example studio_client -- "$(address)"
//!
//! The address is the line that `robert studio` printed. Opens an example, moves its second key by
//! a quarter of a second, and prints the effect on the error. It uses plain HTTP/1.1 on a socket,
//! because the interface needs no library.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use serde_json::{Value, json};

type Failure = Box<dyn std::error::Error>;

/// A running studio.
#[derive(Debug)]
pub struct Studio {
    host: String,
    token: String,
}

impl Studio {
    /// From the line that it printed.
    pub fn at(address: &str) -> Result<Studio, Failure> {
        let (base, token) = address.trim().split_once("/#token=").ok_or("this is no address")?;
        let host = base.trim_start_matches("http://").to_owned();
        Ok(Studio { host, token: token.to_owned() })
    }

    /// Sends one request; a refusal is an error with its message.
    pub fn ask(&self, method: &str, path: &str, body: &Value) -> Result<Value, Failure> {
        let body = body.to_string();
        let (host, token, n) = (&self.host, &self.token, body.len());
        let mut stream = TcpStream::connect(host)?;
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {token}\r\n\
             Content-Type: application/json\r\nContent-Length: {n}\r\nConnection: close\r\n\r\n{body}"
        )?;
        let mut text = String::new();
        stream.read_to_string(&mut text)?;
        let (head, body) = text.split_once("\r\n\r\n").ok_or("half an answer")?;
        let value: Value = serde_json::from_str(body)?;
        if head.split(' ').nth(1) == Some("200") {
            return Ok(value);
        }
        Err(value["message"].as_str().unwrap_or(head).into())
    }

    /// Mean error of the rollout of this version, once it is done.
    pub fn error(&self, rev: &Value) -> Result<f64, Failure> {
        loop {
            let state = self.ask("GET", "/api/rollout", &Value::Null)?["state"].take();
            if &state["rev"] == rev && state["phase"] == "done" {
                return Ok(state["mae"].as_f64().ok_or("no goal was in sight")?);
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

pub fn later(studio: &Studio) -> Result<(f64, f64), Failure> {
    let opened = studio.ask("POST", "/api/gallery/pointmass%2Fstar", &Value::Null)?;
    let before = studio.error(&opened["rev"])?;
    let frame = &opened["clip"]["keys"][1]["frame"];
    let ops = json!([{"op": "keys.move", "args": {"frames": [frame], "df": 5}}]);
    let edited = studio.ask("POST", "/api/ops", &json!({"ops": ops}))?;
    Ok((before, studio.error(&edited["rev"])?))
}

#[allow(dead_code)] // the tests include this file
fn main() -> Result<(), Failure> {
    let address = std::env::args().nth(1).ok_or("name the address that `robert studio` printed")?;
    let (before, after) = later(&Studio::at(&address)?)?;
    println!("mean error {:.2} mm, with the key 0.25 s later {:.2} mm", before * 1e3, after * 1e3);
    Ok(())
}

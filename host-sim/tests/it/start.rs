//! The page for the first half hour: its commands, in its order, as a reader types them.

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    process::{Child, Command, Stdio},
};

use crate::common::{Files, wait_until};

const PAGE: &str = include_str!("../../../docs/start.md");

/// A program that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The commands of the page, and its file.
fn page() -> (Vec<&'static str>, &'static str) {
    let commands = PAGE.lines().filter_map(|line| line.strip_prefix("    "));
    let commands = commands.filter(|line| !line.starts_with("cargo "));
    let (_, file) = PAGE.split_once("```toml\n").unwrap();
    (commands.collect(), file.split_once("```").unwrap().0)
}

fn typed(files: &Files, command: &str) -> Command {
    let mut words = command.split_whitespace();
    assert_eq!(words.next(), Some("host-sim"), "{command}");
    let mut typed = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    // A test has no browser on its screen.
    typed.args(words.filter(|word| *word != "--open"));
    typed
        .current_dir(files.path(""))
        .stdin(Stdio::null())
        .stderr(Stdio::piped())
        .stdout(Stdio::piped());
    typed
}

/// Types a command that ends by itself, and returns its output.
fn ends(files: &Files, command: &str) -> String {
    ends_saying(files, command).0
}

/// The same with its messages.
fn ends_saying(files: &Files, command: &str) -> (String, String) {
    let ended = typed(files, command).output().unwrap();
    let told = String::from_utf8_lossy(&ended.stdout).into_owned();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(ended.status.success(), "{command}: {told}{said}");
    (told, said)
}

/// A command that serves a page, with the address and the token that it prints.
fn serves(files: &Files, command: &str) -> (Running, String, String) {
    let mut child = typed(files, command).spawn().unwrap();
    let mut line = String::new();
    let out = child.stdout.as_mut().unwrap();
    BufReader::new(out).read_line(&mut line).unwrap();
    let url = line.trim().strip_prefix("http://").expect(&line);
    let (address, token) = url.split_once("/#").unwrap();
    (Running(child), address.to_owned(), token.to_owned())
}

/// The server's whole answer.
fn answer(address: &str, request: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

fn get(address: &str, path: &str) -> String {
    answer(
        address,
        &format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n"),
    )
}

#[test]
fn the_first_half_hour_goes_as_the_page_says() {
    let files = Files::new();
    let (commands, file) = page();
    let mut commands = commands.into_iter();
    let mut next = |begin: &str| {
        let command = commands.next().unwrap();
        assert!(
            command.starts_with(begin),
            "{command} where {begin} is expected"
        );
        command
    };
    let told = ends(&files, next("host-sim run lab"));
    let (before, after) = told.split_once("cameras are calibrated").expect(&told);
    assert!(after.contains("nothing is left to do"), "{told}");
    assert!(
        !before.contains("| camera |") && after.contains("| camera |"),
        "{told}"
    );
    {
        let (_server, address, token) = serves(&files, next("host-sim live lab"));
        assert!(get(&address, &format!("/about?token={token}")).contains("\"simulation\""));
    }
    files.write("room.toml", file);
    {
        let (_server, address, token) = serves(&files, next("host-sim edit room.toml"));
        let site = get(&address, &format!("/site?token={token}"));
        let site = site.split_once("\r\n\r\n").unwrap().1;
        let site: serde_json::Value = serde_json::from_str(site).unwrap();
        let mut layout = site["layout"].clone();
        layout["networks"][0][2]["x"] = 0.3.into();
        let body = serde_json::json!({ "version": site["version"], "layout": layout }).to_string();
        let saved = answer(
            &address,
            &format!(
                "POST /save HTTP/1.1\r\nHost: {address}\r\nOrigin: http://{address}\r\nX-Token: {token}\r\n\
                 Content-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
                body.len()
            ),
        );
        assert!(saved.contains("saved as room.toml"), "{saved}");
    }
    let saved = fs::read_to_string(files.path("room.toml")).unwrap();
    assert_eq!(saved, file.replace("id = 3, x = 0.2", "id = 3, x = 0.3"));
    let told = ends(&files, next("host-sim run room.toml"));
    assert!(told.contains("4 of 4 cameras are calibrated"), "{told}");
    ends(&files, next("host-sim run room.toml --until-calibrated"));
    let report = fs::read_to_string(files.path("room.html")).unwrap();
    assert!(report.starts_with("<!DOCTYPE html>"));
    {
        let mut rehearsal = typed(&files, next("host-sim run room.toml --console line"));
        let rehearsal = rehearsal.stdout(Stdio::null()).stderr(Stdio::null());
        let mut rehearsal = Running(rehearsal.spawn().unwrap());
        wait_until(|| fs::symlink_metadata(files.path("line")).is_ok());
        let told = ends(&files, next("host-sim console --port line"));
        assert!(
            told.contains("the program at the other end of the line has ended"),
            "{told}"
        );
        assert!(told.contains("4 of 4 cameras are calibrated"), "{told}");
        rehearsal.0.wait().unwrap();
        let mut again = typed(&files, "host-sim run room.toml --console line --speed 20x");
        let _again = Running(
            again
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap(),
        );
        wait_until(|| fs::symlink_metadata(files.path("line")).is_ok());
        let (_server, address, token) = serves(&files, next("host-sim live --port line"));
        assert!(get(&address, &format!("/about?token={token}")).contains("\"network\""));
    }
    ends(&files, next("host-sim keygen room.sitekey"));
    ends(&files, next("host-sim provision --site room.toml"));
    let pages = fs::read_dir(files.path("pages")).unwrap().count();
    assert_eq!(pages, 6, "four cameras, a target, a coordinator");
    let (told, said) = ends_saying(&files, next("host-sim flash nrf52840"));
    assert!(told.contains("probe-rs download"), "{told}");
    assert!(said.contains("there is no image"), "{said}");
    assert_eq!(commands.next(), None);
}

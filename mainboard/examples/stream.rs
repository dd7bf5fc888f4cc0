#![allow(missing_docs, clippy::unwrap_used)]
use ferrostep_mainboard::host::{Options as StreamOptions, Stream};
use ferrostep_mainboard::{
    machine::{HOST_PORT, Machine},
    run::{self, *},
    wiring::{Board, Printer},
};
struct S {
    stream: Stream,
    until: u64,
    shown: usize,
}
impl Operator for S {
    fn turn(&mut self, m: &mut Machine, now: u64, _h: &mut dyn rigless::emulator::Host) -> Turn {
        let mb = m.mailbox(HOST_PORT).unwrap();
        let got: Vec<u8> = mb.take().map(|(_, w)| w as u8).collect();
        if !got.is_empty() {
            self.stream.received(now, &got);
        }
        while mb.waiting() < 200 {
            let Some(b) = self.stream.to_send(now) else { break };
            for b in b {
                mb.send(now, u16::from(b));
            }
        }
        for h in &self.stream.heard()[self.shown..] {
            if h.text != "ok" {
                println!("{:.4} {}", h.at_ns as f64 / 1e9, h.text);
            }
        }
        self.shown = self.stream.heard().len();
        if now > self.until || (self.stream.finished() && now > 3_000_000_000) { Turn::Stop } else { Turn::GoOn }
    }
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let board = Board::read(std::path::Path::new(&format!("../boards/{}.toml", a[1]))).unwrap();
    let printer = Printer::read(std::path::Path::new(&format!("../profiles/{}.toml", board.profile))).unwrap();
    let m = Machine::new(&board, &printer, 1).unwrap();
    let image =
        rigless::image::Image::read(std::path::Path::new(&format!("../target/images/{}/ferrostep.elf", a[1])), None)
            .unwrap();
    let lines: Vec<String> = if a[2].ends_with("gcode") {
        std::fs::read_to_string(&a[2]).unwrap().lines().map(str::to_owned).collect()
    } else {
        a[2].split('|').map(str::to_owned).collect()
    };
    let t = std::time::Instant::now();
    let f = run::run(
        m,
        &[image],
        &Options { boot: Some(0x0800_0000 + u64::from(board.boot_offset)), ..Options::default() },
        S {
            stream: Stream::new(lines, StreamOptions { wait_for_start: true, ..StreamOptions::default() }),
            until: a[3].parse::<u64>().unwrap() * 1_000_000_000,
            shown: 0,
        },
    )
    .unwrap();
    println!("wall {:?} {:#?}", t.elapsed(), f.report);
    let p = &f.machine().plant;
    for a in 0..3 {
        println!("axis {a} {} {:?}", p.motion.position_mm(a), p.motion.record(a));
    }
    println!(
        "{:?} {:?} steps {:?}",
        p.motion.sheet().crash(),
        f.machine().decoder.smallest(),
        (0..4).map(|m| f.machine().decoder.steps(m)).collect::<Vec<_>>()
    );
}

#![allow(missing_docs, clippy::unwrap_used)]
use ferrostep_mainboard::{chip::Model, machine::Machine};
use rigless::chip::Timeline;
use rigless::emulator::*;
use rigless::session::Session;
use rigless::time::*;
use std::collections::VecDeque;

#[derive(Debug, Default)]
struct Mail {
    got: Vec<u16>,
    give: VecDeque<u16>,
    echo: bool,
}
impl rigless::snapshot::Store for Mail {}
impl rigless::chip::uart::Peer for Mail {
    fn receive(&mut self, word: u16, _c: &mut Timeline<'_, '_>) {
        self.got.push(word);
        if self.echo {
            self.give.push_back(word);
        }
    }
    fn transmit(&mut self, _now: VirtualNanos) -> Option<u16> {
        self.give.pop_front()
    }
}
struct D {
    stops: u64,
    pins: u64,
    file: VecDeque<String>,
    n: u64,
    acc: u64,
    said: Vec<u8>,
    script: VecDeque<(u64, String)>,
}
impl Driver<Machine> for D {
    fn on_settled(&mut self, _s: &mut Session<Machine>, _h: &mut dyn Host, settled: Settled) {
        if let Settled::Stop(_) = settled {
            self.stops += 1;
        }
        if let Settled::Access { access, .. } = settled {
            self.acc += 1;
            if access.address >> 12 == 0x40020 && access.address & 0x3FF == 0x18 {
                self.pins += 1;
            }
        }
    }
    fn on_stop(&mut self, s: &mut Session<Machine>, stop: Stop, _h: &mut dyn Host) -> Option<VirtualNanos> {
        self.n += 1;
        if self.n % 10000 == 0 {
            use rigless::soc::stm32f427::generated::tim2::Register as R;
            let m = &s.board().chip;
            for t in ["TIM2", "TIM5", "TIM3", "TIM4"] {
                let r = rigless::mcu::Operate::registers(m, t).unwrap();
                println!(
                    "{t} {:x} cr1 {:x} dier {:x} sr {:x} arr {} psc {} ccr1 {}",
                    stop.at.0,
                    r.get(R::Cr1),
                    r.get(R::Dier),
                    r.get(R::Sr),
                    r.get(R::Arr),
                    r.get(R::Psc),
                    r.get(R::Ccr1)
                );
            }
            println!("stops {}", self.stops);
        }
        let port = s.board_mut().chip.serial_port("USART1").unwrap();
        let mail = port.chip_mut::<Mail>().unwrap();
        for b in mail.got.drain(..) {
            self.said.push(b as u8);
            if b == 10 {
                if self.said.starts_with(b"ok") {
                    if let Some(l) = self.file.pop_front() {
                        for b in l.bytes() {
                            mail.give.push_back(u16::from(b));
                        }
                        mail.give.push_back(10);
                    }
                } else {
                    print!("{:.6} {}", stop.at.0 as f64 / 1e9, String::from_utf8_lossy(&self.said));
                }
                self.said.clear();
            }
        }
        while self.script.front().is_some_and(|(t, _)| *t <= stop.at.0) {
            let (_, l) = self.script.pop_front().unwrap();
            for b in l.bytes() {
                mail.give.push_back(u16::from(b));
            }
        }
        (stop.at.0 < std::env::var("S").map_or(10, |s| s.parse().unwrap()) * 1_000_000_000)
            .then_some(VirtualNanos(stop.at.0 + 100_000))
    }
}
fn main() {
    let path = std::env::args().nth(1).unwrap();
    let model = match std::env::args().nth(2).unwrap().as_str() {
        "F446" => Model::F446,
        "F407" => Model::F407,
        _ => Model::F405,
    };
    let mhz: u64 = std::env::args().nth(3).unwrap().parse().unwrap();
    let boot: u64 = u64::from_str_radix(&std::env::args().nth(4).unwrap(), 16).unwrap();
    let mut m = Machine::new(model, mhz * 1_000_000).unwrap();
    m.chip.serial_port("USART1").unwrap().attach(Mail::default());
    m.chip.serial_port("USART2").unwrap().attach(Mail { echo: true, ..Mail::default() });
    for c in 0..16 {
        for a in 1..=3 {
            m.chip
                .converter(a)
                .unwrap()
                .set_input(rigless::soc::stm32f427::peripherals::adc::Channel::new(c).unwrap(), 3150);
        }
    }
    let image = image_read(&path);
    let images = [image];
    let mut start = Start::new(&images);
    start.boot = Some(boot);
    let s = Session::new(Box::new(m), 0, VirtualNanos(100_000)).unwrap();
    let t = std::time::Instant::now();
    let script =
        std::env::args().skip(5).enumerate().map(|(i, l)| (2_000_000_000 + 500_000_000 * i as u64, l + "\n")).collect();
    let f = run(
        s,
        &start,
        D {
            stops: 0,
            pins: 0,
            file: std::env::var("FILE")
                .map(|f| {
                    std::fs::read_to_string(f)
                        .unwrap()
                        .lines()
                        .map(|l| l.split(';').next().unwrap().trim().to_owned())
                        .filter(|l| !l.is_empty())
                        .collect()
                })
                .unwrap_or_default(),
            n: 0,
            acc: 0,
            said: vec![],
            script,
        },
    )
    .unwrap();
    eprintln!(
        "wall {:?} stop {:?} stops {} accesses {:?}",
        t.elapsed(),
        f.stop,
        f.driver.n,
        (f.driver.stops, f.driver.acc, f.driver.pins)
    );
    for u in f.session.unmapped() {
        eprintln!("{u:x?}");
    }
    for u in f.session.refused() {
        eprintln!("{u:x?}");
    }
    for u in f.session.unimplemented().values() {
        eprintln!("{u:x?}");
    }
    for u in f.session.told() {
        eprintln!("{u:x?}");
    }
    for u in f.session.resets() {
        eprintln!("{u:x?}");
    }
    for u in f.session.unrouted() {
        eprintln!("{u:x?}");
    }
}
fn image_read(p: &str) -> rigless::image::Image {
    rigless::image::Image::read(std::path::Path::new(p), None).unwrap()
}

//! A device controller in memory, with the host's side and the driver's.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};

use usb_device::bus::{PollResult, UsbBus};
use usb_device::endpoint::{EndpointAddress, EndpointType};
use usb_device::{Result, UsbDirection, UsbError};

/// Answer of a device to a transaction (USB 2.0, 8.4.5).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// An IN transaction's data; the host has acknowledged it.
    Data(Vec<u8>),
    /// OUT or SETUP data were taken.
    Ack,
    /// NAK: not now.
    Nak,
    /// STALL: refused.
    Stall,
    /// No device has this address, or the endpoint is not set up.
    Silence,
}

/// The controller; clones are the same one, the driver's side and the host's.
#[derive(Clone, Default)]
pub struct Bus(Arc<Mutex<Controller>>);

#[derive(Default)]
struct Controller {
    address: u8,
    is_enabled: bool,
    is_reset: bool,
    signal: Option<Signal>,
    /// Number of times that the driver has polled the controller.
    polls: usize,
    /// True if the controller shows something that makes the driver panic.
    is_broken: bool,
    ins: BTreeMap<usize, In>,
    outs: BTreeMap<usize, Out>,
}

/// A signal of the whole bus.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Signal {
    Reset,
    Suspend,
    Resume,
}

#[derive(Default)]
struct In {
    size: usize,
    packet: Option<Vec<u8>>,
    is_complete: bool,
    is_stalled: bool,
}

#[derive(Default)]
struct Out {
    size: usize,
    packet: Option<Vec<u8>>,
    is_setup: bool,
    is_stalled: bool,
}

impl Bus {
    fn lock(&self) -> MutexGuard<'_, Controller> {
        self.0.lock().unwrap()
    }

    /// The host resets the bus: the device loses its address, and pending transfers are lost.
    pub fn signal_reset(&self) {
        let mut controller = self.lock();
        controller.signal = Some(Signal::Reset);
        controller.is_reset = false;
        controller.address = 0;
        controller.ins.values_mut().for_each(|endpoint| {
            endpoint.packet = None;
            endpoint.is_complete = false;
        });
        controller.outs.values_mut().for_each(|endpoint| endpoint.packet = None);
    }

    /// The bus is idle for 3 ms: the host sleeps, or the cable has been pulled.
    pub fn signal_suspend(&self) {
        self.lock().signal = Some(Signal::Suspend);
    }

    /// The host wakes up.
    pub fn signal_resume(&self) {
        self.lock().signal = Some(Signal::Resume);
    }

    /// Breaks the controller: the driver must not access it any more.
    pub fn break_down(&self) {
        self.lock().is_broken = true;
    }

    /// Returns true if the controller shows nothing that the driver panics at.
    pub fn is_sound(&self) -> bool {
        !self.lock().is_broken
    }

    /// Number of times that the driver has polled the controller.
    pub fn polls(&self) -> usize {
        self.lock().polls
    }

    /// An IN transaction.
    pub fn read(&self, address: u8, endpoint: usize) -> Answer {
        let mut controller = self.lock();
        if !controller.answers(address) {
            return Answer::Silence;
        }
        let Some(endpoint) = controller.ins.get_mut(&endpoint) else { return Answer::Silence };
        if endpoint.is_stalled {
            return Answer::Stall;
        }
        let Some(packet) = endpoint.packet.take() else { return Answer::Nak };
        endpoint.is_complete = true;
        Answer::Data(packet)
    }

    /// An OUT transaction.
    pub fn write(&self, address: u8, endpoint: usize, data: &[u8]) -> Answer {
        self.give(address, endpoint, data, false)
    }

    /// A SETUP transaction.
    pub fn setup(&self, address: u8, request: [u8; 8]) -> Answer {
        self.give(address, 0, &request, true)
    }

    fn give(&self, address: u8, endpoint: usize, data: &[u8], is_setup: bool) -> Answer {
        let mut controller = self.lock();
        if !controller.answers(address) {
            return Answer::Silence;
        }
        if is_setup {
            // A new request ends the one before (USB 2.0, 5.5.5).
            if let Some(control) = controller.ins.get_mut(&0) {
                *control = In { size: control.size, ..In::default() };
            }
        }
        let Some(endpoint) = controller.outs.get_mut(&endpoint) else { return Answer::Silence };
        assert!(data.len() <= endpoint.size, "the host may not send {} bytes at once", data.len());
        if endpoint.is_stalled && !is_setup {
            return Answer::Stall;
        }
        if endpoint.packet.is_some() && !is_setup {
            return Answer::Nak;
        }
        endpoint.is_setup = is_setup;
        endpoint.packet = Some(data.to_vec());
        Answer::Ack
    }

    /// Sizes of the bulk IN and OUT endpoints' packets.
    pub fn packet_sizes(&self, endpoint_in: usize, endpoint_out: usize) -> (usize, usize) {
        let controller = self.lock();
        (controller.ins[&endpoint_in].size, controller.outs[&endpoint_out].size)
    }
}

impl Controller {
    fn answers(&self, address: u8) -> bool {
        self.is_enabled && self.is_reset && self.address == address
    }
}

impl UsbBus for Bus {
    fn alloc_ep(
        &mut self,
        direction: UsbDirection,
        address: Option<EndpointAddress>,
        _: EndpointType,
        max_packet_size: u16,
        _: u8,
    ) -> Result<EndpointAddress> {
        let mut controller = self.lock();
        let size = usize::from(max_packet_size);
        let is_taken = |index: &usize| match direction {
            UsbDirection::In => controller.ins.contains_key(index),
            UsbDirection::Out => controller.outs.contains_key(index),
        };
        let index = match address {
            Some(address) => address.index(),
            None => (1..4).find(|index| !is_taken(index)).ok_or(UsbError::EndpointOverflow)?,
        };
        if is_taken(&index) {
            return Err(UsbError::InvalidEndpoint);
        }
        match direction {
            UsbDirection::In => drop(controller.ins.insert(index, In { size, ..In::default() })),
            UsbDirection::Out => drop(controller.outs.insert(index, Out { size, ..Out::default() })),
        }
        Ok(EndpointAddress::from_parts(index, direction))
    }

    fn enable(&mut self) {
        self.lock().is_enabled = true;
    }

    fn reset(&self) {
        let mut controller = self.lock();
        controller.is_reset = true;
        controller.address = 0;
        controller.ins.values_mut().for_each(|endpoint| *endpoint = In { size: endpoint.size, ..In::default() });
        controller.outs.values_mut().for_each(|endpoint| *endpoint = Out { size: endpoint.size, ..Out::default() });
    }

    fn set_device_address(&self, address: u8) {
        self.lock().address = address;
    }

    fn write(&self, address: EndpointAddress, data: &[u8]) -> Result<usize> {
        let mut controller = self.lock();
        let endpoint = controller.ins.get_mut(&address.index()).ok_or(UsbError::InvalidEndpoint)?;
        if data.len() > endpoint.size {
            return Err(UsbError::BufferOverflow);
        }
        if endpoint.packet.is_some() {
            return Err(UsbError::WouldBlock);
        }
        endpoint.packet = Some(data.to_vec());
        Ok(data.len())
    }

    fn read(&self, address: EndpointAddress, buffer: &mut [u8]) -> Result<usize> {
        let mut controller = self.lock();
        let endpoint = controller.outs.get_mut(&address.index()).ok_or(UsbError::InvalidEndpoint)?;
        let packet = endpoint.packet.as_ref().ok_or(UsbError::WouldBlock)?;
        let place = buffer.get_mut(..packet.len()).ok_or(UsbError::BufferOverflow)?;
        place.copy_from_slice(packet);
        let length = packet.len();
        endpoint.packet = None;
        Ok(length)
    }

    fn set_stalled(&self, address: EndpointAddress, stalled: bool) {
        let mut controller = self.lock();
        let index = address.index();
        match address.direction() {
            UsbDirection::In => controller.ins.get_mut(&index).unwrap().is_stalled = stalled,
            UsbDirection::Out => controller.outs.get_mut(&index).unwrap().is_stalled = stalled,
        }
    }

    fn is_stalled(&self, address: EndpointAddress) -> bool {
        let controller = self.lock();
        let index = address.index();
        match address.direction() {
            UsbDirection::In => controller.ins.get(&index).is_none_or(|endpoint| endpoint.is_stalled),
            UsbDirection::Out => controller.outs.get(&index).is_none_or(|endpoint| endpoint.is_stalled),
        }
    }

    fn suspend(&self) {}

    fn resume(&self) {}

    fn poll(&self) -> PollResult {
        let mut controller = self.lock();
        controller.polls += 1;
        match controller.signal.take() {
            Some(Signal::Reset) => return PollResult::Reset,
            Some(Signal::Suspend) => return PollResult::Suspend,
            Some(Signal::Resume) => return PollResult::Resume,
            None => {}
        }
        let (mut ep_in_complete, mut ep_out, mut ep_setup) = (0, 0, 0);
        for (index, endpoint) in &mut controller.ins {
            ep_in_complete |= u16::from(std::mem::take(&mut endpoint.is_complete)) << index;
        }
        for (index, endpoint) in &controller.outs {
            let bit = u16::from(endpoint.packet.is_some()) << index;
            *(if endpoint.is_setup { &mut ep_setup } else { &mut ep_out }) |= bit;
        }
        if ep_in_complete | ep_out | ep_setup == 0 {
            return PollResult::None;
        }
        PollResult::Data { ep_out, ep_in_complete, ep_setup }
    }
}

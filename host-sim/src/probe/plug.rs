//! Ports that come and go with a USB plug.

use std::{fs, path::Path};

use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo};

use super::port::available;

/// A device at a USB plug, known by its serial number: after it was away, the system may give it another name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plug {
    usb: UsbPortInfo,
    /// Name of its port when it was first seen.
    name: String,
}

impl Plug {
    /// The device behind a port, if the system tells its serial number.
    pub fn of(path: &str) -> Option<Self> {
        // Such as a link in `/dev/serial/by-id`.
        let name = fs::canonicalize(path).ok();
        let name = name.as_deref().and_then(Path::to_str).unwrap_or(path);
        Self::among(&available(), name)
    }

    fn among(ports: &[SerialPortInfo], name: &str) -> Option<Self> {
        let port = ports.iter().find(|port| port.port_name == name)?;
        match &port.port_type {
            SerialPortType::UsbPort(usb) if usb.serial_number.is_some() => Some(Self {
                usb: usb.clone(),
                name: name.to_owned(),
            }),
            _ => None,
        }
    }

    /// Name that its port has now, if it is plugged in.
    pub fn path(&self) -> Option<String> {
        self.path_among(&available())
    }

    fn path_among(&self, ports: &[SerialPortInfo]) -> Option<String> {
        let is_it = |port: &&SerialPortInfo| matches!(&port.port_type, SerialPortType::UsbPort(usb) if *usb == self.usb);
        // macOS has two names for each port, of which the user chose one kind.
        let kind = |name: &str| {
            name.trim_end_matches(|c: char| c.is_ascii_digit())
                .to_owned()
        };
        let names = ports.iter().filter(is_it).map(|port| &port.port_name);
        let best = names.min_by_key(|name| (**name != self.name, kind(name) != kind(&self.name)));
        best.cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(name: &str, serial: Option<&str>, interface: u8) -> SerialPortInfo {
        SerialPortInfo {
            port_name: name.to_owned(),
            port_type: SerialPortType::UsbPort(UsbPortInfo {
                vid: 0x1915,
                pid: 0x520f,
                serial_number: serial.map(str::to_owned),
                manufacturer: None,
                product: None,
                interface: Some(interface),
            }),
        }
    }

    #[test]
    fn a_device_is_found_under_another_name_and_no_other_device_is_taken_for_it() {
        let before = [
            port("/dev/ttyACM0", Some("A"), 0),
            port("/dev/ttyACM1", Some("A"), 2),
        ];
        let plug = Plug::among(&before, "/dev/ttyACM1").unwrap();
        // Another device of the same kind has its name now.
        let after = [
            port("/dev/ttyACM1", Some("B"), 2),
            port("/dev/ttyACM2", Some("A"), 0),
            port("/dev/ttyACM3", Some("A"), 2),
        ];
        assert_eq!(plug.path_among(&after).as_deref(), Some("/dev/ttyACM3"));
        assert_eq!(plug.path_among(&after[..2]), None);
    }

    #[test]
    fn of_two_names_of_a_port_the_one_of_the_users_kind_is_taken() {
        let before = [
            port("/dev/cu.usbmodem11", Some("A"), 0),
            port("/dev/tty.usbmodem11", Some("A"), 0),
        ];
        let plug = Plug::among(&before, "/dev/tty.usbmodem11").unwrap();
        let after = [
            port("/dev/cu.usbmodem14", Some("A"), 0),
            port("/dev/tty.usbmodem14", Some("A"), 0),
        ];
        assert_eq!(
            plug.path_among(&after).as_deref(),
            Some("/dev/tty.usbmodem14")
        );
        assert_eq!(
            plug.path_among(&before).as_deref(),
            Some("/dev/tty.usbmodem11")
        );
    }

    #[test]
    fn without_a_serial_number_nothing_is_found_by_it() {
        assert_eq!(
            Plug::among(&[port("/dev/ttyUSB0", None, 0)], "/dev/ttyUSB0"),
            None
        );
    }
}

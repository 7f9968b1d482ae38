//! Addresses of controllers: a host and a port, or a serial device.

use crate::cell::field_error::Findings;

/// Requires `host:port`, the port from 1 to 65535.
pub(super) fn check_socket(pointer: &str, address: &str, findings: &mut Findings) {
    findings
        .require(is_socket(address), pointer, || format!("is {address:?}; allowed is HOST:PORT, for example 192.168.0.10:10003"));
}

/// Requires `tcp://host:port`, or the path of a serial device.
pub(super) fn check_socket_or_serial(pointer: &str, address: &str, findings: &mut Findings) {
    let is_device = address.starts_with('/') && address.len() > 1 && !address.chars().any(char::is_control);
    let is_fit = is_device || address.strip_prefix("tcp://").is_some_and(is_socket);
    findings.require(is_fit, pointer, || {
        format!("is {address:?}; allowed is tcp://HOST:PORT or the path of a serial device, for example /dev/ttyUSB0")
    });
}

/// Returns true for a name or an IP address with a port.
fn is_socket(address: &str) -> bool {
    let Some((host, port)) = address.rsplit_once(':') else { return false };
    let is_host = |c: char| c.is_ascii_alphanumeric() || ".-_".contains(c);
    let is_v6 = || host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).is_some_and(|host| host.parse::<V6>().is_ok());
    let is_named = !host.is_empty() && host.chars().all(is_host);
    port.parse::<u16>().is_ok_and(|port| port > 0) && (is_named || is_v6())
}

/// Address of IP version 6.
type V6 = core::net::Ipv6Addr;

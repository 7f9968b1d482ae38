//! Networks of addresses, as settings name them: an address alone, or an address with the length of its prefix (CIDR: RFC 4632,
//! section 3.1; for IPv6 RFC 4291, section 2.3).

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::str::FromStr;

/// Length of the prefix of IPv4-mapped IPv6 addresses, `::ffff:0:0/96` (RFC 4291, section 2.5.5.2).
const MAPPED_LENGTH: u8 = 96;

/// Length of the prefix that all addresses of an IPv6 client have in common, bits. An end site is given a /64 at the least, and
/// should be given more (RFC 6177, section 2); a host takes any of the 2⁶⁴ addresses in one (RFC 4291, section 2.5.1; RFC 8981).
const CLIENT_LENGTH: u8 = 64;

/// IpNetwork of addresses that begin with the same bits; one of a single address has all of its bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct IpNetwork {
    /// Lowest address; that of an IPv4 network is never in its IPv6 form.
    address: IpAddr,
    /// Number of leading bits that all addresses have in common.
    prefix: u8,
}

impl IpNetwork {
    /// Network that counts as one client with the address: of IPv6 its /64, of IPv4 the address alone, in its IPv6 form too
    /// (`::ffff:0:0/96`).
    pub(super) fn of_client(address: IpAddr) -> Self {
        let address = address.to_canonical();
        let prefix = width(address).min(CLIENT_LENGTH);
        Self { address: lowest(address, prefix), prefix }
    }

    /// Returns true if the address is in the network; an IPv4-mapped IPv6 address counts as the IPv4 address.
    #[must_use]
    pub fn contains(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        let differing = bits(self.address) ^ bits(address);
        address.is_ipv4() == self.address.is_ipv4() && differing.leading_zeros() >= u32::from(self.prefix)
    }
}

/// Bits of an address, those of an IPv4 address leading.
fn bits(address: IpAddr) -> u128 {
    match address {
        IpAddr::V4(address) => u128::from(u32::from(address)) << 96,
        IpAddr::V6(address) => u128::from(address),
    }
}

/// Number of bits of an address.
fn width(address: IpAddr) -> u8 {
    if address.is_ipv4() { 32 } else { 128 }
}

/// Lowest address of the network of an address with a prefix of this length.
fn lowest(address: IpAddr, prefix: u8) -> IpAddr {
    // Without a prefix nothing is left of the mask, and the shift would be by its whole width.
    let mask = u128::MAX.checked_shl(128 - u32::from(prefix)).unwrap_or(0);
    let bits = bits(address) & mask;
    if address.is_ipv4() { Ipv4Addr::from((bits >> 96) as u32).into() } else { Ipv6Addr::from(bits).into() }
}

impl From<IpAddr> for IpNetwork {
    fn from(address: IpAddr) -> Self {
        let address = address.to_canonical();
        Self { address, prefix: width(address) }
    }
}

impl From<[u8; 4]> for IpNetwork {
    fn from(address: [u8; 4]) -> Self {
        IpAddr::from(address).into()
    }
}

impl FromStr for IpNetwork {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (address, prefix) = text.split_once('/').map_or((text, None), |(address, prefix)| (address, Some(prefix)));
        let address: IpAddr = address.parse().map_err(|_| {
            "is not an IP address; give one, such as 10.0.0.1, or a network with the length of its prefix, such as 10.0.0.0/8"
                .to_owned()
        })?;
        let Some(prefix) = prefix else { return Ok(address.into()) };
        let width = width(address);
        let is_plain = prefix.bytes().all(|c| c.is_ascii_digit());
        let length = prefix.parse().ok().filter(|length: &u8| is_plain && *length <= width);
        let length = length.ok_or_else(|| {
            format!("has {prefix:?} as the length of its prefix, in bits; allowed is a whole number from 0 to {width}")
        })?;
        let network = Self { address: lowest(address, length), prefix: length };
        if network.address != address {
            // Which of the two was meant is not known, and the larger one would trust others too.
            return Err(format!("is not the lowest address of its network; give {network}, or {address} for that address alone"));
        }
        let mapped = length.checked_sub(MAPPED_LENGTH).filter(|_| address.is_ipv6() && address.to_canonical().is_ipv4());
        Ok(mapped.map_or(network, |prefix| Self { address: address.to_canonical(), prefix }))
    }
}

impl fmt::Display for IpNetwork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { address, prefix } = self;
        if *prefix == width(*address) { write!(f, "{address}") } else { write!(f, "{address}/{prefix}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn network(text: &str) -> IpNetwork {
        text.parse().expect(text)
    }

    #[test]
    fn a_network_holds_the_addresses_that_begin_with_its_prefix_and_no_others() {
        for (text, inside, outside) in [
            ("10.0.0.0/8", &["10.0.0.0", "10.255.255.255", "::ffff:10.1.2.3"][..], &["9.255.255.255", "11.0.0.0", "a00::"][..]),
            ("172.16.0.0/12", &["172.16.0.0", "172.31.255.255"], &["172.15.255.255", "172.32.0.0"]),
            ("192.168.1.128/25", &["192.168.1.128", "192.168.1.255"], &["192.168.1.127", "192.168.2.128"]),
            ("10.0.0.1", &["10.0.0.1", "::ffff:10.0.0.1"], &["10.0.0.0", "10.0.0.2"]),
            ("10.0.0.1/32", &["10.0.0.1"], &["10.0.0.0", "10.0.0.2"]),
            ("0.0.0.0/0", &["0.0.0.0", "255.255.255.255", "::ffff:1.2.3.4"], &["::", "::1"]),
            ("::/0", &["::", "::1", "ffff::"], &["0.0.0.0", "::ffff:1.2.3.4"]),
            ("fd00::/8", &["fd00::", "fdff::1"], &["fc00::", "fe00::", "253.0.0.0"]),
            ("2001:db8::/33", &["2001:db8::", "2001:db8:7fff::"], &["2001:db8:8000::", "2001:db9::"]),
            ("::1", &["::1"], &["::", "::2", "0.0.0.1"]),
            ("::ffff:10.0.0.0/104", &["10.0.0.0", "10.255.255.255"], &["11.0.0.0"]),
            ("::ffff:0:0/96", &["0.0.0.0", "255.255.255.255"], &["::1"]),
            ("::ffff:10.0.0.1", &["10.0.0.1"], &["10.0.0.2"]),
        ] {
            let network = network(text);
            let address = |text: &&str| text.parse::<IpAddr>().expect("an address");
            for (expected, addresses) in [(true, inside), (false, outside)] {
                for at in addresses {
                    assert_eq!(network.contains(address(at)), expected, "{at} in {text}");
                }
            }
        }
    }

    #[test]
    fn a_client_is_an_ipv4_address_or_an_ipv6_network_of_64_bits() {
        for (address, client) in [
            ("10.0.0.1", "10.0.0.1"),
            ("::ffff:10.0.0.1", "10.0.0.1"),
            ("2001:db8::1", "2001:db8::/64"),
            ("2001:db8::ffff:ffff:ffff:ffff", "2001:db8::/64"),
            ("2001:db8:0:1::1", "2001:db8:0:1::/64"),
            ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
            ("::1", "::/64"),
        ] {
            assert_eq!(IpNetwork::of_client(address.parse().expect("an address")), network(client), "{address}");
        }
    }

    #[test]
    fn a_network_is_written_as_it_is_read() {
        for (text, written) in [
            ("10.0.0.0/8", "10.0.0.0/8"),
            ("10.0.0.1/32", "10.0.0.1"),
            ("::1/128", "::1"),
            ("fd00::/8", "fd00::/8"),
            ("0.0.0.0/0", "0.0.0.0/0"),
            ("::ffff:10.0.0.0/104", "10.0.0.0/8"),
        ] {
            assert_eq!(network(text).to_string(), written);
            assert_eq!(network(written), network(text));
        }
        assert_eq!(IpNetwork::from([10, 0, 0, 1]), network("10.0.0.1"));
    }

    #[test]
    fn what_is_no_network_is_refused_with_what_is_allowed() {
        for (text, reason) in [
            ("proxy", "is not an IP address; give one, such as 10.0.0.1, or a network"),
            ("", "is not an IP address"),
            ("/8", "is not an IP address"),
            ("10.0.0/8", "is not an IP address"),
            ("10.0.0.0/33", "has \"33\" as the length of its prefix, in bits; allowed is a whole number from 0 to 32"),
            ("fd00::/129", "has \"129\" as the length of its prefix, in bits; allowed is a whole number from 0 to 128"),
            ("10.0.0.0/", "has \"\" as the length"),
            ("10.0.0.0/+8", "has \"+8\" as the length"),
            ("10.0.0.0/-1", "has \"-1\" as the length"),
            ("10.0.0.0/8/8", "has \"8/8\" as the length"),
            ("10.0.0.0/255.0.0.0", "has \"255.0.0.0\" as the length"),
            ("10.1.2.3/8", "is not the lowest address of its network; give 10.0.0.0/8, or 10.1.2.3 for that address alone"),
            ("fd00::1/8", "give fd00::/8, or fd00::1 for that address alone"),
            ("::ffff:10.0.0.0/90", "is not the lowest address of its network"),
        ] {
            let told = text.parse::<IpNetwork>().expect_err(text);
            assert!(told.contains(reason), "{text:?}: {told}");
        }
    }
}

//! Modbus requests over one connection, RTU or TCP, one at a time. An answer that does not belong to the request ends the
//! link: on a serial line nothing tells a late answer from the one awaited, so after a request that was given up its answer
//! is waited out.

use std::time::Duration;

use tokio::time::{Instant, timeout_at};

use super::stream::{Connection, within};
use crate::cell::WordOrder;
use crate::execution::device::DeviceError;
use crate::execution::protocol::modbus::{
    ModbusAdu, ModbusError, ModbusFraming, ModbusReply, ModbusRequest, ModbusSide, exception_text, registers_of, values_of,
};

/// A Modbus connection to one node.
#[derive(Debug)]
pub struct ModbusLink {
    connection: Connection,
    framing: ModbusFraming,
    node: u8,
    wait: Duration,
    transaction: u16,
    held: Vec<u8>,
    /// Time until which the answer to a request that was given up may come.
    owed_until: Option<Instant>,
}

impl ModbusLink {
    /// A link to a node, with the longest wait for an answer.
    #[must_use]
    pub fn new(connection: Connection, framing: ModbusFraming, node: u8, wait: Duration) -> Self {
        Self { connection, framing, node, wait, transaction: 0, held: Vec::new(), owed_until: None }
    }

    /// Reads coils.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn coils(&mut self, address: u16, count: u16) -> Result<Vec<bool>, DeviceError> {
        match self.ask(&ModbusRequest::ReadCoils { address, count }).await? {
            ModbusReply::Coils(on) => Ok(on),
            reply @ (ModbusReply::Registers(_) | ModbusReply::Written | ModbusReply::Exception(_)) => {
                Err(malformed(&format!("{reply:?}")))
            }
        }
    }

    /// Reads registers.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn registers(&mut self, address: u16, count: u16) -> Result<Vec<u16>, DeviceError> {
        match self.ask(&ModbusRequest::ReadRegisters { address, count }).await? {
            ModbusReply::Registers(values) => Ok(values),
            reply @ (ModbusReply::Coils(_) | ModbusReply::Written | ModbusReply::Exception(_)) => {
                Err(malformed(&format!("{reply:?}")))
            }
        }
    }

    /// Sets a coil.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn set_coil(&mut self, address: u16, on: bool) -> Result<(), DeviceError> {
        self.ask(&ModbusRequest::WriteCoil { address, on }).await.map(drop)
    }

    /// Writes one register.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn set_register(&mut self, address: u16, value: u16) -> Result<(), DeviceError> {
        self.ask(&ModbusRequest::WriteRegister { address, value }).await.map(drop)
    }

    /// Writes registers in one request.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn set_registers(&mut self, address: u16, values: Vec<u16>) -> Result<(), DeviceError> {
        self.ask(&ModbusRequest::WriteRegisters { address, values }).await.map(drop)
    }

    /// Reads 32-bit values, two registers each.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn values(&mut self, address: u16, count: u16, order: WordOrder) -> Result<Vec<i32>, DeviceError> {
        Ok(values_of(&self.registers(address, 2 * count).await?, order))
    }

    /// Reads a 32-bit value.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn value(&mut self, address: u16, order: WordOrder) -> Result<i32, DeviceError> {
        let value = self.values(address, 1, order).await?.first().copied();
        value.ok_or_else(|| malformed(&format!("no value in register {address:#06x}")))
    }

    /// Writes a 32-bit value in one request.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn set_value(&mut self, address: u16, value: i32, order: WordOrder) -> Result<(), DeviceError> {
        self.set_registers(address, registers_of(&[value], order)).await
    }

    /// Sends a request and waits for its answer.
    ///
    /// # Errors
    /// [`DeviceError`]; an exception is [`DeviceError::Refused`].
    pub async fn ask(&mut self, request: &ModbusRequest) -> Result<ModbusReply, DeviceError> {
        self.send(request).await?;
        self.answer(request).await
    }

    /// Sends a stop and waits for its answer, for `patience` at most; an answer that is owed from before is waited out for half
    /// of it, and the stop goes out whether it came or not. Times are those of
    /// [`MotionDevice::stop`](crate::execution::device::MotionDevice::stop).
    ///
    /// # Errors
    /// [`DeviceError`]; an exception is [`DeviceError::Refused`].
    pub async fn stop(
        &mut self,
        stop: &ModbusRequest,
        patience: Duration,
        sent_at: &mut Option<Instant>,
    ) -> Result<Instant, DeviceError> {
        self.owed_until = self.owed_until.map(|until| until.min(Instant::now() + patience / 2));
        let stopped = async {
            self.send(stop).await?;
            sent_at.get_or_insert_with(Instant::now);
            self.answer(stop).await?;
            Ok(Instant::now())
        };
        within(patience, stopped).await
    }

    /// Hands a request to the wire.
    ///
    /// # Errors
    /// [`DeviceError`].
    async fn send(&mut self, request: &ModbusRequest) -> Result<(), DeviceError> {
        self.wait_out().await?;
        self.transaction = self.transaction.wrapping_add(1);
        self.owed_until = Some(Instant::now() + self.wait);
        let adu = ModbusAdu { transaction: self.transaction, node: self.node, pdu: request.pdu() };
        within(self.wait, self.connection.send(&adu.frame(self.framing))).await
    }

    /// Waits for the answer to the request that was sent last.
    ///
    /// # Errors
    /// [`DeviceError`]; an exception is [`DeviceError::Refused`].
    async fn answer(&mut self, request: &ModbusRequest) -> Result<ModbusReply, DeviceError> {
        let adu = within(self.wait, self.own_frame()).await?;
        self.owed_until = None;
        match request.parse_reply(&adu.pdu).map_err(|error| malformed(&error.to_string()))? {
            ModbusReply::Exception(code) => {
                Err(DeviceError::Refused { code: code.into(), text: exception_text(code).to_owned() })
            }
            reply @ (ModbusReply::Coils(_) | ModbusReply::Registers(_) | ModbusReply::Written) => Ok(reply),
        }
    }

    /// Next frame, of this transaction where frames have numbers.
    async fn own_frame(&mut self) -> Result<ModbusAdu, DeviceError> {
        loop {
            let adu = self.frame().await?;
            if self.framing == ModbusFraming::Tcp && adu.transaction != self.transaction {
                continue;
            }
            if adu.node != self.node {
                return Err(malformed(&format!("an answer of node {} where {} was asked", adu.node, self.node)));
            }
            return Ok(adu);
        }
    }

    async fn frame(&mut self) -> Result<ModbusAdu, DeviceError> {
        loop {
            let taken = ModbusAdu::take(&mut self.held, self.framing, ModbusSide::Client);
            if let Some(adu) = taken.map_err(|error: ModbusError| malformed(&error.to_string()))? {
                return Ok(adu);
            }
            self.connection.receive(&mut self.held).await?;
        }
    }

    /// Waits for the answer to a request that was given up, as long as it may take, and throws it away. Frames of TCP have
    /// numbers and need no waiting.
    async fn wait_out(&mut self) -> Result<(), DeviceError> {
        let Some(until) = self.owed_until.filter(|_| self.framing == ModbusFraming::Rtu) else { return Ok(()) };
        if let Ok(Err(closed @ DeviceError::Closed { .. })) = timeout_at(until, self.frame()).await {
            return Err(closed);
        }
        self.owed_until = None;
        self.held.clear();
        Ok(())
    }

    /// Ends the connection.
    pub async fn close(self) {
        self.connection.close().await;
    }
}

fn malformed(what: &str) -> DeviceError {
    DeviceError::Malformed { what: what.to_owned() }
}

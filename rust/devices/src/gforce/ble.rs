//! Armbands over Bluetooth low energy, through `btleplug` (on Linux: BlueZ over D-Bus, no special rights).
//!
//! Thin on purpose: everything that can be tested without a radio is above [`GattLink`]. This file has been compiled
//! and not yet run with an armband.

use super::{
    link::{Connect, GattLink, LinkError},
    protocol::{COMMAND_CHARACTERISTIC, Characteristic, DATA_CHARACTERISTIC, SERVICE},
};
use btleplug::{
    api::{
        Central, Characteristic as GattCharacteristic, Manager as _, Peripheral as _, ScanFilter, WriteType,
    },
    platform::{Manager, Peripheral},
};
use futures_util::StreamExt;
use std::{
    sync::mpsc::{Receiver, RecvTimeoutError, channel},
    time::Duration,
};
use tokio::runtime::Runtime;
use uuid::Uuid;

/// Longest search for an armband.
const SCAN: Duration = Duration::from_secs(10);
/// Longest wait for a connection, or for the service to be listed.
const CONNECT: Duration = Duration::from_secs(10);
/// Time between two looks at what was found.
const GLANCE: Duration = Duration::from_millis(200);

/// Finds armbands by the service that they advertise, and connects.
#[derive(Debug)]
pub struct BleConnector {
    runtime: Runtime,
    /// Part of the name or the address of the one wanted; any, if empty.
    wanted: String,
}

impl BleConnector {
    /// For the armband whose name or address contains `wanted`; for the first one found if that is empty.
    ///
    /// # Errors
    /// The system gives no threads.
    pub fn new(wanted: impl Into<String>) -> Result<BleConnector, LinkError> {
        // The radio's events are handled on a thread of their own, also while nobody waits for them.
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        Ok(BleConnector { runtime, wanted: wanted.into() })
    }

    async fn find(&self) -> Result<Peripheral, LinkError> {
        let manager = Manager::new().await.map_err(radio("Bluetooth cannot be used"))?;
        let adapters = manager.adapters().await.map_err(radio("Bluetooth cannot be used"))?;
        let Some(adapter) = adapters.into_iter().next() else {
            return Err(LinkError::Radio("this machine has no Bluetooth adapter".to_owned()));
        };
        let service = uuid(SERVICE)?;
        let filter = ScanFilter { services: vec![service] };
        adapter.start_scan(filter).await.map_err(radio("the search for armbands cannot start"))?;
        let looks = SCAN.as_millis() / GLANCE.as_millis();
        let mut found = None;
        'search: for _ in 0..looks {
            tokio::time::sleep(GLANCE).await;
            for peripheral in adapter.peripherals().await.map_err(radio("the search for armbands failed"))? {
                // Systems hand out devices that other programs searched for, too.
                let Ok(Some(properties)) = peripheral.properties().await else { continue };
                let name = properties.local_name.unwrap_or_default();
                let names = [name, peripheral.address().to_string()];
                if properties.services.contains(&service) && names.iter().any(|n| n.contains(&self.wanted)) {
                    found = Some(peripheral);
                    break 'search;
                }
            }
        }
        // A search that goes on only costs power.
        let _ = adapter.stop_scan().await;
        found.ok_or_else(|| {
            let seconds = SCAN.as_secs();
            LinkError::Radio(format!(
                "no armband advertises itself within {seconds} s; is it charged and on?"
            ))
        })
    }

    async fn open(&self) -> Result<Parts, LinkError> {
        let peripheral = self.find().await?;
        let late = |_| LinkError::Radio(format!("the armband did not answer within {} s", CONNECT.as_secs()));
        tokio::time::timeout(CONNECT, peripheral.connect())
            .await
            .map_err(late)?
            .map_err(radio("the armband refuses the connection"))?;
        tokio::time::timeout(CONNECT, peripheral.discover_services())
            .await
            .map_err(late)?
            .map_err(radio("the armband does not list its services"))?;
        let characteristics = peripheral.characteristics();
        let find = |name: &str| {
            let wanted = uuid(name)?;
            let found = characteristics.iter().find(|c| c.uuid == wanted).cloned();
            found.ok_or_else(|| LinkError::Radio(format!("the armband has no characteristic {name}")))
        };
        let (command, data) = (find(COMMAND_CHARACTERISTIC)?, find(DATA_CHARACTERISTIC)?);
        // Listened to before they are switched on, so that the first one is not missed.
        let mut stream = peripheral.notifications().await.map_err(radio("no notifications"))?;
        for characteristic in [&command, &data] {
            peripheral.subscribe(characteristic).await.map_err(radio("no notifications"))?;
        }
        let (sender, notifications) = channel();
        let (command_uuid, data_uuid) = (command.uuid, data.uuid);
        tokio::spawn(async move {
            // Ends with the connection, or when nobody listens any more; dropping the sender tells the other side.
            while let Some(notification) = stream.next().await {
                let characteristic = match notification.uuid {
                    id if id == command_uuid => Characteristic::Command,
                    id if id == data_uuid => Characteristic::Data,
                    _ => continue,
                };
                if sender.send((characteristic, notification.value)).is_err() {
                    break;
                }
            }
        });
        Ok(Parts { peripheral, command, data, notifications })
    }
}

impl Connect for BleConnector {
    fn connect(&mut self) -> Result<Box<dyn GattLink>, LinkError> {
        let parts = self.runtime.block_on(self.open())?;
        Ok(Box::new(BleLink { handle: self.runtime.handle().clone(), parts }))
    }

    fn name(&self) -> String {
        "Bluetooth".to_owned()
    }
}

struct Parts {
    peripheral: Peripheral,
    command: GattCharacteristic,
    data: GattCharacteristic,
    notifications: Receiver<(Characteristic, Vec<u8>)>,
}

struct BleLink {
    handle: tokio::runtime::Handle,
    parts: Parts,
}

impl GattLink for BleLink {
    fn write(&mut self, characteristic: Characteristic, bytes: &[u8]) -> Result<(), LinkError> {
        let target = match characteristic {
            Characteristic::Command => &self.parts.command,
            Characteristic::Data => &self.parts.data,
        };
        let write = self.parts.peripheral.write(target, bytes, WriteType::WithResponse);
        self.handle.block_on(write).map_err(radio("the armband cannot be written to"))
    }

    fn next_notification(
        &mut self,
        timeout: Duration,
        bytes: &mut Vec<u8>,
    ) -> Result<Option<Characteristic>, LinkError> {
        match self.parts.notifications.recv_timeout(timeout) {
            Ok((characteristic, value)) => {
                *bytes = value;
                Ok(Some(characteristic))
            }
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(LinkError::Closed),
        }
    }
}

impl Drop for BleLink {
    fn drop(&mut self) {
        // Otherwise the system keeps the armband, and nobody else can connect. It may be gone already.
        let _ = self.handle.block_on(self.parts.peripheral.disconnect());
    }
}

fn uuid(text: &str) -> Result<Uuid, LinkError> {
    Uuid::parse_str(text).map_err(|e| LinkError::Radio(format!("{text} is no UUID: {e}")))
}

fn radio(what: &'static str) -> impl Fn(btleplug::Error) -> LinkError {
    move |error| LinkError::Radio(format!("{what}: {error}"))
}

//! Armbands over Bluetooth low energy, through `btleplug` (on Linux: BlueZ over D-Bus, no special rights).
//!
//! Thin on purpose: everything that can be tested without a radio is above [`GattLink`]. This file has been compiled
//! and not yet run with an armband.

use super::{
    link::{GattConnector, GattLink, LinkError},
    protocol::{COMMAND_CHARACTERISTIC, Characteristic, DATA_CHARACTERISTIC, SERVICE},
};
use crate::myo::protocol as myo;
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
const SCAN_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest wait for a connection, or for the service to be listed.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Time between two looks at what was found.
const POLL_INTERVAL: Duration = Duration::from_millis(200);

/// What an armband has, by UUID.
#[derive(Clone, Copy, Debug)]
struct GattProfile {
    service: &'static str,
    /// Written to, or read.
    read_write: &'static [(Characteristic, &'static str)],
    /// Notify.
    notify: &'static [(Characteristic, &'static str)],
}

const GFORCE: GattProfile = GattProfile {
    service: SERVICE,
    read_write: &[],
    notify: &[(Characteristic::Command, COMMAND_CHARACTERISTIC), (Characteristic::Data, DATA_CHARACTERISTIC)],
};

const MYO: GattProfile = GattProfile {
    service: myo::SERVICE,
    read_write: &[
        (Characteristic::Command, myo::COMMAND_CHARACTERISTIC),
        (Characteristic::Firmware, myo::FIRMWARE_CHARACTERISTIC),
        (Characteristic::Battery, myo::BATTERY_CHARACTERISTIC),
    ],
    notify: &[
        (Characteristic::Emg0, myo::EMG_CHARACTERISTICS[0]),
        (Characteristic::Emg1, myo::EMG_CHARACTERISTICS[1]),
        (Characteristic::Emg2, myo::EMG_CHARACTERISTICS[2]),
        (Characteristic::Emg3, myo::EMG_CHARACTERISTICS[3]),
        (Characteristic::Imu, myo::IMU_CHARACTERISTIC),
    ],
};

/// Finds armbands by the service that they advertise, and connects.
#[derive(Debug)]
pub struct BleConnector {
    runtime: Runtime,
    profile: GattProfile,
    /// Part of the name or the address of the one wanted; any, if empty.
    name_filter: String,
}

impl BleConnector {
    /// For the gForce whose name or address contains `name_filter`; for the first one found if that is empty.
    ///
    /// # Errors
    /// The system gives no threads.
    pub fn new(name_filter: impl Into<String>) -> Result<BleConnector, LinkError> {
        Self::with_profile(GFORCE, name_filter.into())
    }

    /// The same for a Myo.
    ///
    /// # Errors
    /// The system gives no threads.
    pub fn myo(name_filter: impl Into<String>) -> Result<BleConnector, LinkError> {
        Self::with_profile(MYO, name_filter.into())
    }

    fn with_profile(profile: GattProfile, name_filter: String) -> Result<BleConnector, LinkError> {
        // The radio's events are handled on a thread of their own, also while nobody waits for them.
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        Ok(BleConnector { runtime, profile, name_filter })
    }

    async fn find(&self) -> Result<Peripheral, LinkError> {
        let manager = Manager::new().await.map_err(radio_error("Bluetooth cannot be used"))?;
        let adapters = manager.adapters().await.map_err(radio_error("Bluetooth cannot be used"))?;
        let Some(adapter) = adapters.into_iter().next() else {
            return Err(LinkError::Radio("this machine has no Bluetooth adapter".to_owned()));
        };
        let service = uuid(self.profile.service)?;
        let filter = ScanFilter { services: vec![service] };
        adapter.start_scan(filter).await.map_err(radio_error("the search for armbands cannot start"))?;
        let scan_count = SCAN_TIMEOUT.as_millis() / POLL_INTERVAL.as_millis();
        let mut found = None;
        'search: for _ in 0..scan_count {
            tokio::time::sleep(POLL_INTERVAL).await;
            for peripheral in
                adapter.peripherals().await.map_err(radio_error("the search for armbands failed"))?
            {
                // Systems hand out devices that other programs searched for, too.
                let Ok(Some(properties)) = peripheral.properties().await else { continue };
                let name = properties.local_name.unwrap_or_default();
                let names = [name, peripheral.address().to_string()];
                if properties.services.contains(&service)
                    && names.iter().any(|n| n.contains(&self.name_filter))
                {
                    found = Some(peripheral);
                    break 'search;
                }
            }
        }
        // A search that goes on only costs power.
        let _ = adapter.stop_scan().await;
        found.ok_or_else(|| {
            let seconds = SCAN_TIMEOUT.as_secs();
            LinkError::Radio(format!(
                "no armband advertises itself within {seconds} s; is it charged and on?"
            ))
        })
    }

    async fn open(&self) -> Result<GattConnection, LinkError> {
        let peripheral = self.find().await?;
        let late = |_| {
            LinkError::Radio(format!("the armband did not answer within {} s", CONNECT_TIMEOUT.as_secs()))
        };
        tokio::time::timeout(CONNECT_TIMEOUT, peripheral.connect())
            .await
            .map_err(late)?
            .map_err(radio_error("the armband refuses the connection"))?;
        tokio::time::timeout(CONNECT_TIMEOUT, peripheral.discover_services())
            .await
            .map_err(late)?
            .map_err(radio_error("the armband does not list its services"))?;
        let characteristics = peripheral.characteristics();
        let find = |name: &str| {
            let wanted = uuid(name)?;
            let found = characteristics.iter().find(|c| c.uuid == wanted).cloned();
            found.ok_or_else(|| LinkError::Radio(format!("the armband has no characteristic {name}")))
        };
        let found = |list: &[(Characteristic, &str)]| {
            let pairs =
                list.iter().map(|(characteristic, name)| find(name).map(|gatt| (*characteristic, gatt)));
            pairs.collect::<Result<Vec<_>, LinkError>>()
        };
        let (read_write, notify) = (found(self.profile.read_write)?, found(self.profile.notify)?);
        // Listened to before they are switched on, so that the first one is not missed.
        let mut stream = peripheral.notifications().await.map_err(radio_error("no notifications"))?;
        for (_, characteristic) in &notify {
            peripheral.subscribe(characteristic).await.map_err(radio_error("no notifications"))?;
        }
        let (sender, notifications) = channel();
        let listened: Vec<(Uuid, Characteristic)> = notify.iter().map(|(c, gatt)| (gatt.uuid, *c)).collect();
        tokio::spawn(async move {
            // Ends with the connection, or when nobody listens any more; dropping the sender tells the other side.
            while let Some(notification) = stream.next().await {
                let known = listened.iter().find(|(uuid, _)| *uuid == notification.uuid);
                let Some((_, characteristic)) = known else { continue };
                if sender.send((*characteristic, notification.value)).is_err() {
                    break;
                }
            }
        });
        let characteristics = read_write.into_iter().chain(notify).collect();
        Ok(GattConnection { peripheral, characteristics, notifications })
    }
}

impl GattConnector for BleConnector {
    fn connect(&mut self) -> Result<Box<dyn GattLink>, LinkError> {
        let connection = self.runtime.block_on(self.open())?;
        Ok(Box::new(BleLink { handle: self.runtime.handle().clone(), connection }))
    }

    fn name(&self) -> String {
        "Bluetooth".to_owned()
    }
}

struct GattConnection {
    peripheral: Peripheral,
    characteristics: Vec<(Characteristic, GattCharacteristic)>,
    notifications: Receiver<(Characteristic, Vec<u8>)>,
}

struct BleLink {
    handle: tokio::runtime::Handle,
    connection: GattConnection,
}

impl BleLink {
    fn find(&self, characteristic: Characteristic) -> Result<&GattCharacteristic, LinkError> {
        let found = self.connection.characteristics.iter().find(|(known, _)| *known == characteristic);
        let absent = || LinkError::Radio(format!("this armband has no characteristic {characteristic:?}"));
        found.map(|(_, gatt)| gatt).ok_or_else(absent)
    }
}

impl GattLink for BleLink {
    fn read(
        &mut self,
        characteristic: Characteristic,
        timeout: Duration,
    ) -> Result<Option<Vec<u8>>, LinkError> {
        let target = self.find(characteristic)?;
        let read = self.connection.peripheral.read(target);
        // The time-out is made within the runtime, which it needs.
        let read = self.handle.block_on(async { tokio::time::timeout(timeout, read).await });
        match read {
            Ok(bytes) => bytes.map(Some).map_err(radio_error("the armband cannot be read")),
            Err(_) => Ok(None),
        }
    }

    fn write(&mut self, characteristic: Characteristic, bytes: &[u8]) -> Result<(), LinkError> {
        let target = self.find(characteristic)?;
        let write = self.connection.peripheral.write(target, bytes, WriteType::WithResponse);
        self.handle.block_on(write).map_err(radio_error("the armband cannot be written to"))
    }

    fn next_notification(
        &mut self,
        timeout: Duration,
        bytes: &mut Vec<u8>,
    ) -> Result<Option<Characteristic>, LinkError> {
        match self.connection.notifications.recv_timeout(timeout) {
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
        let _ = self.handle.block_on(self.connection.peripheral.disconnect());
    }
}

fn uuid(text: &str) -> Result<Uuid, LinkError> {
    Uuid::parse_str(text).map_err(|e| LinkError::Radio(format!("{text} is no UUID: {e}")))
}

fn radio_error(what: &'static str) -> impl Fn(btleplug::Error) -> LinkError {
    move |error| LinkError::Radio(format!("{what}: {error}"))
}

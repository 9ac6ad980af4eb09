//! Parquet tables, as far as datasets need them.
//!
//! It uses the low-level writer of the `parquet` crate, without Arrow. Readers accept plain lists
//! for any kind of list, and so a third of the packages need not be compiled.

use std::sync::Arc;

use parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{
    BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type,
};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::{Type, TypePtr};

use super::super::error::Error;

/// The content of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Int,
    Float,
    Double,
    Bool,
    Text,
    Ints,
    Floats,
    Doubles,
    Texts,
}

/// Values of one column in one row group. All lists except texts have a fixed width.
#[derive(Clone, Debug)]
pub(super) enum Column {
    Int(Vec<i64>),
    Float(Vec<f32>),
    Double(Vec<f64>),
    Bool(Vec<bool>),
    Text(Vec<String>),
    Ints(usize, Vec<i64>),
    Floats(usize, Vec<f32>),
    Doubles(usize, Vec<f64>),
    Texts(Vec<Vec<String>>),
}

/// A table that is being written, one row group at a time.
pub(super) struct Table {
    writer: SerializedFileWriter<Vec<u8>>,
}

impl Table {
    /// An empty table of these columns; `metadata` are the file's own keys.
    pub(super) fn new(
        columns: &[(String, Kind)],
        metadata: Option<(&str, String)>,
    ) -> Result<Table, Error> {
        let fields: Result<Vec<TypePtr>, ParquetError> =
            columns.iter().map(|(name, kind)| field(name, *kind)).collect();
        let schema =
            Type::group_type_builder("schema").with_fields(fields.map_err(failed)?).build();
        let metadata = metadata.map(|(key, value)| vec![KeyValue::new(key.to_owned(), value)]);
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(format!("robert {}", env!("CARGO_PKG_VERSION")))
            .set_key_value_metadata(metadata)
            .build();
        let schema = Arc::new(schema.map_err(failed)?);
        let writer = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties));
        Ok(Table { writer: writer.map_err(failed)? })
    }

    /// Adds rows as one row group; columns in the table's order.
    pub(super) fn group(&mut self, columns: &[Column]) -> Result<(), Error> {
        let mut group = self.writer.next_row_group().map_err(failed)?;
        for column in columns {
            let Some(mut writer) = group.next_column().map_err(failed)? else {
                unreachable!("a row group has the columns of its table")
            };
            column.write(&mut writer).map_err(failed)?;
            writer.close().map_err(failed)?;
        }
        group.close().map_err(failed)?;
        Ok(())
    }

    /// Bytes so far.
    pub(super) fn size(&self) -> usize {
        self.writer.bytes_written()
    }

    /// The file.
    pub(super) fn finish(self) -> Result<Vec<u8>, Error> {
        self.writer.into_inner().map_err(failed)
    }
}

impl Column {
    fn write(&self, to: &mut SerializedColumnWriter<'_>) -> Result<(), ParquetError> {
        let texts =
            |t: &[String]| t.iter().map(|t| ByteArray::from(t.as_str())).collect::<Vec<_>>();
        match self {
            Column::Int(v) => plain::<Int64Type>(to, v),
            Column::Float(v) => plain::<FloatType>(to, v),
            Column::Double(v) => plain::<DoubleType>(to, v),
            Column::Bool(v) => plain::<BoolType>(to, v),
            Column::Text(v) => plain::<ByteArrayType>(to, &texts(v)),
            Column::Ints(width, v) => {
                lists::<Int64Type>(to, v, std::iter::repeat_n(*width, v.len() / width))
            }
            Column::Floats(width, v) => {
                lists::<FloatType>(to, v, std::iter::repeat_n(*width, v.len() / width))
            }
            Column::Doubles(width, v) => {
                lists::<DoubleType>(to, v, std::iter::repeat_n(*width, v.len() / width))
            }
            Column::Texts(v) => {
                let flat = texts(&v.concat());
                lists::<ByteArrayType>(to, &flat, v.iter().map(Vec::len))
            }
        }
    }
}

fn plain<T: DataType>(
    to: &mut SerializedColumnWriter<'_>,
    values: &[T::T],
) -> Result<(), ParquetError> {
    to.typed::<T>().write_batch(values, None, None)?;
    Ok(())
}

/// Lists have at least one element: definition levels are all 1, and repetition levels mark the
/// beginnings.
fn lists<T: DataType>(
    to: &mut SerializedColumnWriter<'_>,
    values: &[T::T],
    widths: impl Iterator<Item = usize>,
) -> Result<(), ParquetError> {
    let mut repetition = Vec::with_capacity(values.len());
    for width in widths {
        assert!(width > 0, "a list of a dataset has elements");
        repetition.push(0);
        repetition.extend(std::iter::repeat_n(1, width - 1));
    }
    let definition = vec![1; values.len()];
    to.typed::<T>().write_batch(values, Some(&definition), Some(&repetition))?;
    Ok(())
}

fn field(name: &str, kind: Kind) -> Result<TypePtr, ParquetError> {
    let scalar = |name: &str| {
        let physical = match kind {
            Kind::Int | Kind::Ints => Physical::INT64,
            Kind::Float | Kind::Floats => Physical::FLOAT,
            Kind::Double | Kind::Doubles => Physical::DOUBLE,
            Kind::Bool => Physical::BOOLEAN,
            Kind::Text | Kind::Texts => Physical::BYTE_ARRAY,
        };
        let built =
            Type::primitive_type_builder(name, physical).with_repetition(Repetition::REQUIRED);
        let is_text = matches!(kind, Kind::Text | Kind::Texts);
        let built = if is_text { built.with_converted_type(ConvertedType::UTF8) } else { built };
        built.build().map(Arc::new)
    };
    let group = |name: &str, repetition, inner, converted| {
        Type::group_type_builder(name)
            .with_repetition(repetition)
            .with_converted_type(converted)
            .with_fields(vec![inner])
            .build()
            .map(Arc::new)
    };
    match kind {
        Kind::Int | Kind::Float | Kind::Double | Kind::Bool | Kind::Text => scalar(name),
        Kind::Ints | Kind::Floats | Kind::Doubles | Kind::Texts => {
            let list =
                group("list", Repetition::REPEATED, scalar("element")?, ConvertedType::NONE)?;
            group(name, Repetition::REQUIRED, list, ConvertedType::LIST)
        }
    }
}

#[allow(clippy::needless_pass_by_value)] // it is what map_err hands over
fn failed(e: ParquetError) -> Error {
    Error::Encode { what: "the parquet file", problem: e.to_string() }
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::record::RowAccessor as _;

    use super::*;

    #[test]
    fn every_kind_of_column_comes_back() {
        let columns = [
            ("a.b".to_owned(), Kind::Int),
            ("c/d".to_owned(), Kind::Text),
            ("e".to_owned(), Kind::Floats),
            ("f".to_owned(), Kind::Texts),
            ("g".to_owned(), Kind::Bool),
        ];
        let mut table = Table::new(&columns, Some(("pandas", "{}".to_owned()))).unwrap();
        for base in [0, 10] {
            let group = [
                Column::Int(vec![base, base + 1]),
                Column::Text(vec!["x".into(), "y z".into()]),
                Column::Floats(3, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
                Column::Texts(vec![vec!["p".into()], vec!["q".into(), "r".into()]]),
                Column::Bool(vec![true, false]),
            ];
            table.group(&group).unwrap();
        }
        let reader =
            SerializedFileReader::new(bytes::Bytes::from(table.finish().unwrap())).unwrap();
        assert_eq!(reader.num_row_groups(), 2);
        let keys = reader.metadata().file_metadata().key_value_metadata().unwrap();
        assert_eq!(keys[0].key, "pandas");
        let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
        assert_eq!(rows.len(), 4);
        assert_eq!(rows[3].get_long(0).unwrap(), 11);
        assert_eq!(rows[3].get_string(1).unwrap(), "y z");
        let list = rows[1].get_list(2).unwrap().elements().to_vec();
        assert_eq!(list.len(), 3);
        assert_eq!(format!("{:?}", list[2]), "Float(6.0)");
        assert_eq!(rows[1].get_list(3).unwrap().len(), 2);
        assert!(!rows[3].get_bool(4).unwrap());
    }
}
